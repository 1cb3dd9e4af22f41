"""What a page is told of a run: the values of its recording, and no more than a bounded part of them."""

import json
import math
import tracemalloc
from collections.abc import Sequence

import msgspec
import pytest

from hil_bridge.api import Simulation, simulate
from hil_bridge.recording import CycleRecord, EventRecord, Recording, RunEnd, SensorRecord, TruthRecord
from hil_bridge.recording.ending import Outcome
from hil_bridge.recording.topics import Record
from hil_bridge.view import Health, Scene
from hil_bridge.web import wire
from hil_bridge.web.columns import CYCLE, ROWS, TRUTH, Columns
from hil_bridge.web.picture import EVENTS, Cursor, Picture
