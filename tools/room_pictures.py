"""Draw the two pictures of docs/explanation/architecture.md: the rooms with the arrows that matter, and the data's way.

Each box names its modules and each arrow stands for imports, so that a test compares both with the code.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

LOOK = """
  .band { fill: #f6f8fa; stroke: #d0d7de } .room { fill: #ffffff; stroke: #57708f } .real { fill: #fff1e5; stroke: #bc4c00 }
  .title { font: 600 14px ui-monospace, monospace; fill: #59636e } .small { font: 11px system-ui, sans-serif; text-anchor: middle; fill: #59636e }
  .name { font: 600 13px system-ui, sans-serif; text-anchor: middle; fill: #1f2328 }
  .line, .dash { stroke: #0969da; stroke-width: 1.4; fill: none } .dash { stroke-dasharray: 4 3 } #head path { fill: #0969da }
  @media (prefers-color-scheme: dark) {
    .band { fill: #151b23; stroke: #3d444d } .room { fill: #0d1117; stroke: #7d94b3 } .real { fill: #2b1d12; stroke: #f0883e }
    .title, .small { fill: #9198a1 } .name { fill: #f0f6fc } .line, .dash { stroke: #4493f8 } #head path { fill: #4493f8 } }
"""  # noqa: E501


class Box(NamedTuple):
    """A box of the picture, for one or more modules of a package."""

    corner: tuple[float, float]
    """Left and top."""
    size: tuple[float, float]
    title: str
    beside: str = ""
    """Smaller, below the title."""
    modules: Sequence[str] = ()


class Arrow(NamedTuple):
    """An arrow from a box to another, by its corners; dashed where the room is chosen by its name."""

    source: str
    target: str
    way: Sequence[tuple[float, float]]
    dashed: bool = False


SIZE = (960, 560)
BANDS = {"hil_bridge": (10, 330), "emulators": (352, 98), "protocol": (462, 88)}
"""Top and height of each package."""
HOUSE, EMULATORS, WIRES = "hil_bridge.{}", "emulators.{}", "protocol.{}"


def _of(package: str, *names: str) -> list[str]:
    return [package.format(name) for name in names]


ROOMS: Mapping[str, Box] = {
    "cli": Box((150, 24), (150, 40), "cli", "commands", _of(HOUSE, "cli")),
    "site": Box(
        (330, 24),
        (280, 40),
        "site",
        "doctor, probe, identify, free, explain",
        _of(HOUSE, "site"),
    ),
    "api": Box(
        (640, 24),
        (290, 40),
        "api, lab",
        "programs; campaigns, tuning, conform",
        _of(HOUSE, "api", "lab"),
    ),
    "runs": Box((330, 92), (280, 44), "runs", "cycle, session, compose, replay", _of(HOUSE, "runs")),
    "show": Box(
        (30, 164),
        (190, 44),
        "show",
        "reports, pages, terminal",
        _of(HOUSE, "show"),
    ),
    "record": Box((240, 164), (150, 44), "record", "MCAP, analysis, export", _of(HOUSE, "record")),
    "control": Box((410, 164), (150, 44), "control", "course, laws, geometry", _of(HOUSE, "control")),
    "settings": Box((580, 164), (160, 44), "settings", "configuration", _of(HOUSE, "settings")),
    "kinds": Box((760, 164), (170, 44), "devices.kinds", "registry of rooms", _of(HOUSE, "devices.kinds")),
    "facts": Box((240, 236), (150, 40), "devices.facts", "as plain values", _of(HOUSE, "devices.facts")),
    "seams": Box(
        (410, 236),
        (180, 40),
        "seams",
        "asked, streamed, stream",
        _of(
            HOUSE,
            *(
                f"devices.{name}"
                for name in ("robots.seam", "robots.asked", "robots.streamed", "sensors.stream")
            ),
        ),
    ),
    "wiring": Box((610, 236), (130, 40), "devices.wiring", "wires for a room", _of(HOUSE, "devices.wiring")),
    "devices": Box(
        (760, 236),
        (170, 40),
        "robots.*, sensors.*",
        "one room a device",
        _of(
            HOUSE,
            *(f"devices.robots.{name}" for name in ("s3", "egm", "rsi", "rtde")),
            *(f"devices.sensors.{name}" for name in ("jr3", "netft", "ati_can", "ft300")),
        ),
    ),
    "transports": Box(
        (410, 296), (330, 34), "transports: serial, CAN, TCP, UDP, memory", "", _of(HOUSE, "transports")
    ),
    "cell": Box(
        (150, 378),
        (190, 56),
        "cell",
        "joins robot, surface, sensor",
        _of(EMULATORS, "cell"),
    ),
    "arm": Box(
        (360, 378),
        (290, 56),
        "seams, arm, sensing, surface, faults",
        "the general half",
        _of(EMULATORS, "seams", "arm", "sensing", "surface", "faults"),
    ),
    "emulated": Box(
        (670, 378),
        (260, 56),
        "devices: s3, egm, rtde, rsi",
        "jr3, netft, ati_can, ft300",
        _of(EMULATORS, "devices"),
    ),
    "plain": Box(
        (150, 490),
        (240, 46),
        "robot, wrench, geometry",
        "plain values",
        _of(WIRES, "robot", "wrench", "geometry"),
    ),
    "codecs": Box(
        (410, 490),
        (520, 46),
        "devices, one room each",
        "codecs and clients, without I/O",
        _of(WIRES, "devices"),
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
WAY = (
    Box((12, 40), (118, 56), "sensor", "counts, frames"),
    Box((148, 40), (118, 56), "transports", "bytes, stamped", _of(HOUSE, "transports")),
    Box((284, 40), (118, 56), "sensors.stream", "force, tool frame", _of(HOUSE, "devices.sensors.stream")),
    Box((420, 40), (118, 56), "control", "what to command", _of(HOUSE, "control")),
    Box((556, 40), (118, 56), "supervisor", "allow, clamp, stop", _of(HOUSE, "control.course.supervisor")),
    Box((692, 40), (118, 56), "robots", "pose as telegram", _of(HOUSE, "devices.robots")),
    Box((828, 40), (118, 56), "robot", "moves, touches"),
)
"""From the sensor to the robot. A box without modules is a thing outside."""
NOTES = {
    24: "one thread, plain calls, one direction",
    130: "the contact closes the loop: really, or by the emulated cell",
    166: "beside it, never waited for: the recording, the terminal view, the page in the browser",
}
"""Lines of text by their height."""


def drawn_box(box: Box, look: str = "room") -> Iterator[str]:
    """The box with its texts."""
    (x, y), (width, height) = box.corner, box.size
    yield f'<rect class="{look}" x="{x}" y="{y}" width="{width}" height="{height}" rx="6"/>'
    middle, line = x + width / 2, y + height / 2
    yield f'<text class="name" x="{middle}" y="{line - 4 if box.beside else line + 5}">{box.title}</text>'
    if box.beside:
        yield f'<text class="small" x="{middle}" y="{line + 13}">{box.beside}</text>'


def drawn_arrow(way: Sequence[tuple[float, float]], dashed: bool = False) -> str:
    """A line along these corners, with a head at its end."""
    points = " ".join(f"{x},{y}" for x, y in way)
    return f'<polyline class="{"dash" if dashed else "line"}" points="{points}" marker-end="url(#head)"/>'


def document(title: str, size: tuple[int, int], parts: Sequence[str]) -> str:
    """The SVG, which suits a light and a dark page."""
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]} {size[1]}" role="img"',
            f' aria-label="{title}">',
            f"<style>{LOOK}</style>",
            '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"'
            ' orient="auto"><path d="M0 0 L8 4 L0 8 z"/></marker></defs>',
            *parts,
            "</svg>\n",
        ]
    )


def rooms() -> str:
    """The picture of the rooms."""
    parts = []
    for name, (top, height) in BANDS.items():
        parts.append(
            f'<rect class="band" x="10" y="{top}" width="{SIZE[0] - 20}" height="{height}" rx="10"/>'
        )
        parts.append(f'<text class="title" x="24" y="{top + 22}">{name}</text>')
    parts += [drawn_arrow(arrow.way, arrow.dashed) for arrow in ARROWS]
    for box in ROOMS.values():
        parts += drawn_box(box)
    return document("The rooms of the three packages, and the arrows between them", SIZE, parts)


def data_way() -> str:
    """The picture of the data's way."""
    parts, height = [], 190
    for box, after in zip(WAY, [*WAY[1:], None], strict=True):
        parts += drawn_box(box, "room" if box.modules else "real")
        if after is not None:
            parts.append(drawn_arrow([(box.corner[0] + box.size[0], 68), (after.corner[0], 68)]))
    first, last = (box.corner[0] + box.size[0] / 2 for box in (WAY[0], WAY[-1]))
    parts.append(drawn_arrow([(last, 96), (last, 136), (first, 136), (first, 98)]))
    parts += [f'<text class="small" x="{SIZE[0] / 2}" y="{y}">{text}</text>' for y, text in NOTES.items()]
    return document("The way of the data from the sensor to the robot", (SIZE[0], height), parts)


def pictures() -> dict[str, str]:
    """Each picture by the name of its file."""
    return {"rooms.svg": rooms(), "data-way.svg": data_way()}
