"""A client of Foxglove's protocol, over a real WebSocket."""

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
    """Channels and, for so long, the messages of all of them: values of JSON, or the bytes of another encoding.

    Reference: the protocol's specification: `advertise` and `subscribe` are JSON, a message is the byte 1, its
    subscription and its time, little-endian.
    """
    found: dict[str, Any] = {"channels": {}, "messages": {}}
    until = time.monotonic() + seconds
    async with session.ws_connect(f"{run.origin}/", protocols=(protocol,), max_msg_size=0) as socket:
        topics: dict[int, str] = {}
        while time.monotonic() < until:
            with suppress(TimeoutError):
                told = await socket.receive(timeout=0.5)
                if told.type is aiohttp.WSMsgType.TEXT:
                    message = json.loads(told.data)
                    found.setdefault(message["op"], message)
                    if message["op"] == "advertise":
                        wanted = []
                        for channel in message["channels"]:
                            found["channels"][channel["topic"]] = channel
                            topics[channel["id"]] = channel["topic"]
                            wanted.append({"id": channel["id"], "channelId": channel["id"]})
                        await socket.send_json({"op": "subscribe", "subscriptions": wanted})
                elif told.type is aiohttp.WSMsgType.BINARY:
                    kind, subscription, at = struct.unpack_from("<BIQ", told.data)
                    assert kind == 1
                    name, data = topics[subscription], told.data[13:]
                    row = (at, json.loads(data) if found["channels"][name]["encoding"] == "json" else data)
                    found["messages"].setdefault(name, []).append(row)
                else:
                    break
    return found
