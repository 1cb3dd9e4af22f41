"""Client of Foxglove's protocol, over a real WebSocket."""

import json
import struct
import time
from contextlib import suppress
from typing import Any

import aiohttp

from tools.web_run import WebRun


async def foxglove(
    session: aiohttp.ClientSession, run: WebRun, seconds: float, protocol: str = "foxglove.sdk.v1"
) -> dict[str, Any]:
    """Return the channels and, for this long, the messages of all of them: JSON values, or bytes in another encoding.

    Reference: the protocol's specification: `advertise` and `subscribe` are JSON, a message is the byte 1, its
    subscription and its time, little-endian.
    """
    result: dict[str, Any] = {"channels": {}, "messages": {}}
    until = time.monotonic() + seconds
    async with session.ws_connect(f"{run.origin}/", protocols=(protocol,), max_msg_size=0) as socket:
        topics: dict[int, str] = {}
        while time.monotonic() < until:
            with suppress(TimeoutError):
                received = await socket.receive(timeout=0.5)
                if received.type is aiohttp.WSMsgType.TEXT:
                    message = json.loads(received.data)
                    result.setdefault(message["op"], message)
                    if message["op"] == "advertise":
                        subscriptions = []
                        for channel in message["channels"]:
                            result["channels"][channel["topic"]] = channel
                            topics[channel["id"]] = channel["topic"]
                            subscriptions.append({"id": channel["id"], "channelId": channel["id"]})
                        await socket.send_json({"op": "subscribe", "subscriptions": subscriptions})
                elif received.type is aiohttp.WSMsgType.BINARY:
                    kind, subscription, at = struct.unpack_from("<BIQ", received.data)
                    assert kind == 1
                    name, data = topics[subscription], received.data[13:]
                    row = (at, json.loads(data) if result["channels"][name]["encoding"] == "json" else data)
                    result["messages"].setdefault(name, []).append(row)
                else:
                    break
    return result
