"""Tests that every wire must pass, for the author's test module.

    import pytest
    from hil_bridge.testing.transports import StreamCase, TestStreamWire

    @pytest.fixture
    def stream_case():
        return StreamCase("mine", open_two_ends)

pytest then finds the tests of the class in that module. There are two contracts:

- `TestStreamWire`, fixture `stream_case`: bytes or CAN frames that arrive once and in order.
- `TestDatagramWire`, fixture `datagram_case`: datagrams that arrive complete or not at all. Their order may differ, and
  lost datagrams are counted.

A case opens two connected ends. A client opens the left end. On a datagram wire, the left end sends first.
"""

from hil_bridge.testing.datagrams import TestDatagramWire
from hil_bridge.testing.ends import DatagramCase, Ear, Ends, StreamCase
from hil_bridge.testing.streams import TestStreamWire

__all__ = ["DatagramCase", "Ear", "Ends", "StreamCase", "TestDatagramWire", "TestStreamWire"]
