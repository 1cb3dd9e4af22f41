"""Tests that every wire has to pass, for the test module of its author.

    import pytest
    from hil_bridge.testing.transports import StreamCase, TestStreamWire

    @pytest.fixture
    def stream_case():
        return StreamCase("mine", open_two_ends)

pytest then finds the tests of the class in that module. There are two contracts:

- `TestStreamWire`, fixture `stream_case`: bytes or CAN frames that arrive once and in order.
- `TestDatagramWire`, fixture `datagram_case`: datagrams that arrive whole or not at all. Their order may differ, and
  what is lost is counted.

A case opens two ends that are connected. The left end is the one that a client opens, and on a datagram wire it is
the one that speaks first.
"""

from hil_bridge.testing.datagrams import TestDatagramWire
from hil_bridge.testing.ends import DatagramCase, Ear, Ends, StreamCase
from hil_bridge.testing.streams import TestStreamWire

__all__ = ["DatagramCase", "Ear", "Ends", "StreamCase", "TestDatagramWire", "TestStreamWire"]
