"""Recording as a ROS 2 bag: a folder with `metadata.yaml` and an MCAP file of CDR messages. ROS is not required.

`record.ros.messages` defines the topics.
"""

import itertools
import tempfile
from collections.abc import Mapping
from operator import attrgetter
from pathlib import Path
from typing import Literal

from hil_bridge.errors import ConfigError
from hil_bridge.record import Recording
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.ros.messages import TOPICS, Messages, require_rosbags

BAG_NAME = "bag"
"""Name of the MCAP file in the folder, as given in the metadata."""
_METADATA_VERSION: Literal[8] = 8
"""Version of rosbag2's metadata format that ROS 2 Humble and later versions read."""


def bag_files(recording: Recording, zero_ns: int) -> tuple[Mapping[str, bytes], int]:
    """Return the files of a bag by name, and the number of messages; `zero_ns` is the time stamp of the run's zero, ns.

    Raises ConfigError if rosbags is not installed, and for a time that a time stamp cannot represent.
    """
    require_rosbags()
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )
    from rosbags.rosbag2 import StoragePlugin, Writer

    facts = devices_of(recording).sensor.facts
    messages = Messages(zero_ns, None if facts is None else facts.scales)
    streams = (recording.sensors, recording.cycles, recording.truths, recording.events)
    records = itertools.chain.from_iterable(streams)
    made = sorted((one for record in records for one in messages.of(record)), key=attrgetter("stamp_ns"))
    if not made:
        raise ConfigError("it has no data for a ROS 2 bag; give --to bytes")
    unset = QosTime(0, 0)
    # the default of ROS 2 publishers
    qos = Qos(
        QosHistory.KEEP_LAST,
        10,
        QosReliability.RELIABLE,
        QosDurability.VOLATILE,
        unset,
        unset,
        QosLiveliness.AUTOMATIC,
        unset,
        False,
    )
    used = {one.topic for one in made}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / BAG_NAME
        with Writer(place, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP) as bag:
            bag.set_custom_data("hil_bridge", recording.metadata.get("version", ""))
            connections = {
                topic: bag.add_connection(topic, kind, typestore=messages.store, offered_qos_profiles=[qos])
                for topic, kind in TOPICS.items()
                if topic in used
            }
            for one in made:
                bag.write(connections[one.topic], one.stamp_ns, messages.encode(one))
        files = {file.name: file.read_bytes() for file in sorted(place.iterdir())}
    return files, len(made)
