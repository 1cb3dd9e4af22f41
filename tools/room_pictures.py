"""Pictures of docs/explanation/architecture.md: the packages with the main imports between them, and the data path.

Each box names its modules and each arrow represents imports, so that a test can compare both with the code.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from tools.svg import Point, draw_arrow, draw_box, draw_picture, draw_text


class Box(NamedTuple):
    """Box of the picture. It represents one or more modules of a package."""

    corner: Point
    """Left and top of the box."""
    size: Point
    title: str
    note: str = ""
    """Smaller text below the title."""
    package: str = ""
    names: str = ""
    """Names of modules of the package, separated by spaces; empty for a box outside the product."""

    @property
    def modules(self) -> list[str]:
        """Full names of the modules in the box."""
        return [f"{self.package}.{name}" for name in self.names.split()]


class Arrow(NamedTuple):
    """Arrow between two boxes, given by its corners. It is dashed if the target is selected by name at run time."""

    source: str
    target: str
    points: Sequence[Point]
    dashed: bool = False


SIZE = (960, 560)
BANDS = {"hil_bridge": (10, 330), "emulators": (352, 98), "protocol": (462, 88)}
"""Top and height of the band of each package."""
HOUSE, DEVICES, EMULATORS, WIRES = "hil_bridge", "hil_bridge.devices", "emulators", "protocol"
SEAMS = "robots.seam robots.request_channel robots.streamed sensors.stream"
OURS = "robots.s3 robots.egm robots.rsi robots.rtde sensors.jr3 sensors.netft sensors.ati_can sensors.ft300"
GENERAL = "seams, arm, sensing, surface, faults"
TRANSPORTS = "transports: serial, CAN, TCP, UDP, memory"
ROOMS: Mapping[str, Box] = {
    "cli": Box((150, 24), (150, 40), "cli", "commands", HOUSE, "cli"),
    "site": Box((330, 24), (280, 40), "site", "doctor, probe, identify, free, explain", HOUSE, "site"),
    "api": Box((640, 24), (290, 40), "api, lab", "programs; campaigns, tuning, conform", HOUSE, "api lab"),
    "runs": Box((330, 92), (280, 44), "runs", "cycle, session, compose, replay", HOUSE, "runs"),
    "show": Box((30, 164), (190, 44), "show", "reports, pages, terminal", HOUSE, "show"),
    "record": Box((240, 164), (150, 44), "record", "MCAP, analysis, export", HOUSE, "record"),
    "control": Box((410, 164), (150, 44), "control", "course, laws, geometry", HOUSE, "control"),
    "settings": Box((580, 164), (160, 44), "settings", "configuration", HOUSE, "settings"),
    "kinds": Box((760, 164), (170, 44), "devices.kinds", "registry of rooms", DEVICES, "kinds"),
    "facts": Box((240, 236), (150, 40), "devices.facts", "as plain values", DEVICES, "facts"),
    "seams": Box((410, 236), (180, 40), "seams", "asked, streamed, stream", DEVICES, SEAMS),
    "wiring": Box((610, 236), (130, 40), "devices.wiring", "wires for a room", DEVICES, "wiring"),
    "devices": Box((760, 236), (170, 40), "robots.*, sensors.*", "one room a device", DEVICES, OURS),
    "transports": Box((410, 296), (330, 34), TRANSPORTS, "", HOUSE, "transports"),
    "cell": Box((150, 378), (190, 56), "cell", "joins robot, surface, sensor", EMULATORS, "cell"),
    "arm": Box((360, 378), (290, 56), GENERAL, "the general half", EMULATORS, GENERAL.replace(",", "")),
    "emulated": Box(
        (670, 378),
        (260, 56),
        "devices: s3, egm, rtde, rsi",
        "jr3, netft, ati_can, ft300",
        EMULATORS,
        "devices",
    ),
    "plain": Box(
        (150, 490), (240, 46), "robot, wrench, geometry", "plain values", WIRES, "robot wrench geometry"
    ),
    "codecs": Box(
        (410, 490), (520, 46), "devices, one room each", "codecs and clients, without I/O", WIRES, "devices"
    ),
}
ARROWS = (
    Arrow("cli", "runs", [(225, 64), (400, 92)]),
    Arrow("site", "runs", [(470, 64), (470, 92)]),
    Arrow("api", "runs", [(760, 64), (600, 92)]),
    Arrow("runs", "show", [(330, 120), (222, 170)]),
    Arrow("runs", "record", [(380, 136), (330, 164)]),
    Arrow("runs", "control", [(480, 136), (484, 164)]),
    Arrow("runs", "settings", [(570, 136), (640, 164)]),
    Arrow("show", "record", [(220, 186), (240, 186)]),
    Arrow("settings", "kinds", [(740, 186), (760, 186)]),
    Arrow("kinds", "devices", [(845, 208), (845, 236)], dashed=True),
    Arrow("devices", "wiring", [(760, 256), (740, 256)]),
    Arrow("seams", "transports", [(500, 276), (500, 296)]),
    Arrow("wiring", "transports", [(650, 276), (650, 296)]),
    Arrow("record", "facts", [(315, 208), (315, 236)]),
    Arrow("seams", "facts", [(410, 256), (390, 256)]),
    Arrow("devices", "seams", [(790, 276), (790, 286), (575, 286), (575, 277)]),
    Arrow("devices", "emulated", [(830, 276), (830, 378)]),
    Arrow("devices", "codecs", [(930, 256), (942, 256), (942, 512), (931, 512)]),
    Arrow("emulated", "arm", [(670, 406), (650, 406)]),
    Arrow("cell", "arm", [(340, 406), (360, 406)]),
    Arrow("cell", "plain", [(270, 434), (270, 490)]),
    Arrow("emulated", "codecs", [(800, 434), (800, 490)]),
    Arrow("codecs", "plain", [(410, 512), (390, 512)]),
)
PATH = (
    Box((12, 40), (118, 56), "sensor", "counts, frames"),
    Box((148, 40), (118, 56), "transports", "bytes, stamped", HOUSE, "transports"),
    Box((284, 40), (118, 56), "sensors.stream", "force, tool frame", DEVICES, "sensors.stream"),
    Box((420, 40), (118, 56), "control", "what to command", HOUSE, "control"),
    Box((556, 40), (118, 56), "supervisor", "allow, clamp, stop", HOUSE, "control.course.supervisor"),
    Box((692, 40), (118, 56), "robots", "pose as telegram", DEVICES, "robots"),
    Box((828, 40), (118, 56), "robot", "moves, touches"),
)
"""Data path from the sensor to the robot."""
NOTES = {
    24: "one thread, plain calls, one direction",
    130: "the contact closes the loop: really, or by the emulated cell",
    166: "beside it, never waited for: the recording, the terminal view, the page in the browser",
}
"""Lines of text, by their vertical position."""


def draw_rooms() -> str:
    """Draw the packages and their arrows."""
    parts = []
    for name, (top, height) in BANDS.items():
        parts.append(
            f'<rect class="band" x="10" y="{top}" width="{SIZE[0] - 20}" height="{height}" rx="10"/>'
        )
        parts.append(draw_text("title", (24, top + 22), name))
    parts += [draw_arrow(arrow.points, arrow.dashed) for arrow in ARROWS]
    parts += [draw_box(*box[:4]) for box in ROOMS.values()]
    return draw_picture("The rooms of the three packages, and the arrows between them", SIZE, parts)


def draw_path() -> str:
    """Draw the data path."""
    parts = [draw_box(*box[:4], "box" if box.names else "real") for box in PATH]
    for box, after in pairwise(PATH):
        parts.append(draw_arrow([(box.corner[0] + box.size[0], 68), (after.corner[0], 68)]))
    first, last = (box.corner[0] + box.size[0] / 2 for box in (PATH[0], PATH[-1]))
    parts.append(draw_arrow([(last, 96), (last, 136), (first, 136), (first, 98)]))
    parts += [draw_text("small", (SIZE[0] / 2, height), text) for height, text in NOTES.items()]
    return draw_picture("The path of the data from the sensor to the robot", (SIZE[0], 190), parts)


PICTURES = {"rooms.svg": draw_rooms, "data-way.svg": draw_path}
