"""Draw docs/pictures/run.svg, the moving picture of the README, from a run in virtual time.

A tool follows a surface with 10 N. The surface rises by 12 mm, the guard sees the force pass its limit, and retracts
the tool. The picture moves by SMIL, which browsers show also in a page. Every place and force is that of the run.
"""

import bisect
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import hil_bridge
from emulators.surface.profile import SurfaceProfile
from hil_bridge.record import EventKind, Recording
from hil_bridge.settings.configuration import read_config

PLACE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "run.svg"
RISE_MM, RISE_S = 12.0, 4.0
SETTINGS = {
    "run": {"duration_s": 6.0},
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "netft"},
    "task": {"speed_mm_s": 14.0, "retract_mm": 20.0, "approach_speed_mm_s": 6.0},
    "cell": {
        "start_position_mm": [900.0, -100.0, 596.0],
        "surface": {"kind": "sinusoidal", "amplitude_mm": 3.0, "period_mm": 90.0, "origin_y_mm": -100.0},
    },
}
FAULT = {"on": "surface", "fault": "step", "phase": "track", "after_s": RISE_S, "with": {"mm": RISE_MM}}
FRAMES_S = 0.04
"""Time between two places of the picture, s."""
PAUSE_S = 2.0
"""How long the end stays, s."""
WIDTH, HEIGHT = 860, 300
LEFT, TOP, SIDE = 24, 66, 340
"""Corner and width of the scene, px."""
CHART, CHART_WIDTH, FLOOR = 440, 396, 250
"""Corner, width and zero line of the chart, px."""
PX_MM = 4.4
NEWTON_PX = 2.9
MOST_N = 65.0

STYLE = """
  .card { fill: #ffffff; stroke: #d0d7de } .ink { fill: #1f2328 } .dim { fill: #59636e }
  .axis { stroke: #d0d7de } .ground { fill: #8da2bd; stroke: #57708f } .tool { fill: #e36209 }
  .force { stroke: #0969da; fill: none; stroke-width: 2.2 } .arrow { stroke: #0969da; stroke-width: 3 }
  .limit { stroke: #cf222e; stroke-dasharray: 5 4 } .red { fill: #cf222e }
  .target { stroke: #1a7f37; stroke-dasharray: 2 4 }
  .green { fill: #1a7f37 }
  text { font: 13px ui-sans-serif, system-ui, sans-serif } .big { font-size: 19px; font-weight: 600 }
  .mono { font: 600 13px ui-monospace, monospace }
  @media (prefers-color-scheme: dark) {
    .card { fill: #0d1117; stroke: #3d444d } .ink { fill: #f0f6fc } .dim { fill: #9198a1 } .axis { stroke: #3d444d }
    .ground { fill: #4a5b73; stroke: #7d94b3 } .force, .arrow { stroke: #4493f8 } .limit { stroke: #f85149 }
    .red { fill: #f85149 } .target { stroke: #3fb950 } .green { fill: #3fb950 }
  }
"""


class _Drawing:
    """The run as it is drawn, over the time of the picture."""

    def __init__(self, recording: Recording) -> None:
        self.began = recording.cycles[0].started_at
        self.lasts = recording.cycles[-1].answered_at - self.began
        self.whole = self.lasts + PAUSE_S
        count = round(self.lasts / FRAMES_S)
        self.times = [k * FRAMES_S for k in range(count + 1)]
        self._truths, self._cycles = recording.truths, recording.cycles
        self._at = [truth.at for truth in recording.truths]
        self._decided = [cycle.controlled_at for cycle in recording.cycles]
        self.frames = [
            self._truths[min(bisect.bisect_left(self._at, self.began + t), len(self._at) - 1)]
            for t in self.times
        ]
        self.forces = [
            self._cycles[max(0, bisect.bisect_right(self._decided, self.began + t) - 1)].force
            for t in self.times
        ]
        self.events = recording.events

    def share(self, at: float) -> float:
        """A time after the begin, s, as a share of the whole picture's time."""
        return min(1.0, max(0.0, at / self.whole))

    def animated(self, attribute: str, values: Sequence[str]) -> str:
        """An attribute that changes with the frames and then stays."""
        keys = [*(f"{self.share(t):.4f}" for t in self.times), "1"]
        shown = ";".join([*values, values[-1]])
        return (
            f'<animate attributeName="{attribute}" dur="{self.whole:.2f}s" repeatCount="indefinite" '
            f'keyTimes="{";".join(keys)}" values="{shown}"/>'
        )

    def moved(self, places: Sequence[tuple[float, float]]) -> str:
        """A translation that follows these places, px."""
        keys = [*(f"{self.share(t):.4f}" for t in self.times), "1"]
        shown = ";".join(f"{x:.1f},{y:.1f}" for x, y in [*places, places[-1]])
        return (
            f'<animateTransform attributeName="transform" type="translate" dur="{self.whole:.2f}s" '
            f'repeatCount="indefinite" keyTimes="{";".join(keys)}" values="{shown}"/>'
        )

    def between(self, begin: float, end: float) -> str:
        """Shown from one time to another, s; up to the end of the picture where the end is infinite."""
        first, last = self.share(begin), self.share(end) if end < self.whole else 1.0
        keys, values = ["0", f"{first:.4f}", f"{last:.4f}"], ["0", "1", "0"]
        if first <= 0:
            keys, values = ["0", f"{last:.4f}"], ["1", "0"]
        if last >= 1.0:
            keys, values = keys[:-1], values[:-1]
        if len(keys) == 1:
            return ""
        return (
            f'<animate attributeName="opacity" calcMode="discrete" dur="{self.whole:.2f}s" repeatCount="indefinite" '
            f'keyTimes="{";".join(keys)}" values="{";".join(values)}"/>'
        )


def _height_mm(surface: SurfaceProfile, y_mm: float) -> float:
    """Height of the waves, base frame, mm."""
    turn = 2 * math.pi * (y_mm - surface.origin_y_mm) / surface.period_mm
    return surface.height_mm + surface.amplitude_mm * math.sin(turn)


def _picture(recording: Recording, surface: SurfaceProfile) -> str:
    run = _Drawing(recording)
    first = run.frames[0].position
    low = surface.height_mm - surface.amplitude_mm - RISE_MM

    def place(y_mm: float, z_mm: float) -> tuple[float, float]:
        return LEFT + 26 + (y_mm - first[1] * 1e3) * PX_MM, TOP + 176 - (z_mm - low) * PX_MM

    tips = [place(one.position[1] * 1e3, one.position[2] * 1e3) for one in run.frames]
    shape = [place(y, _height_mm(surface, y)) for y in (first[1] * 1e3 - 6.0 + 0.5 * k for k in range(155))]
    ground, bottom = _points(shape), TOP + 176
    fault = next(event.at for event in run.events if event.kind == EventKind.FAULT) - run.began
    stop = next(event for event in run.events if event.kind == EventKind.STOP)
    rise = [(0.0, -min(1.0, max(0.0, (t - fault) / 0.1)) * RISE_MM * PX_MM) for t in run.times]
    points = [
        (CHART + t / run.lasts * CHART_WIDTH, FLOOR - min(force, MOST_N) * NEWTON_PX)
        for t, force in zip(run.times, run.forces, strict=True)
    ]
    line = _points(points)
    limit, target = (FLOOR - newton * NEWTON_PX for newton in (50.0, 10.0))
    phases = [(event.text, event.at - run.began) for event in run.events if event.kind == EventKind.PHASE]
    phases = [(name, max(at, 0.0)) for name, at in phases if name in ("approach", "track", "retract")]
    ends = [*(at for _, at in phases[1:]), run.whole]
    told = "".join(
        f'<text class="big ink" x="{LEFT}" y="50" opacity="0">{name}{run.between(at, end)}</text>'
        for (name, at), end in zip(phases, ends, strict=True)
    )
    arrows = [f"{-min(force, MOST_N) * 0.9:.1f}" for force in run.forces]
    reveal = [f"{max(0.1, x - CHART):.1f}" for x, _ in points]
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img"
  aria-label="A tool follows a surface with 10 N; the surface rises, the guard stops the run and retracts the tool">
<style>{STYLE}</style>
<rect class="card" x="0.5" y="0.5" width="{WIDTH - 1}" height="{HEIGHT - 1}" rx="10"/>
<clipPath id="scene"><rect x="{LEFT}" y="{TOP - 8}" width="{SIDE}" height="{bottom - TOP + 8}"/></clipPath>
<text class="mono green" x="{LEFT}" y="26">EMULATED  egm, netft</text>{told}
<g clip-path="url(#scene)">
<polygon class="ground"
  points="{shape[0][0]:.1f},{bottom + 60} {ground} {shape[-1][0]:.1f},{bottom + 60}">{run.moved(rise)}</polygon>
<g>{run.moved(tips)}
<polygon class="tool" points="0,0 -7,-22 -7,-120 7,-120 7,-22"/>
<line class="arrow" x1="14" x2="14" y1="0" y2="0">{run.animated("y2", arrows)}</line></g>
</g>
<text class="dim" x="{LEFT}" y="{bottom + 24}">tool and surface, to scale; arrow: contact force</text>
<text class="red" x="{LEFT}" y="{bottom + 44}" opacity="0">fault: the surface rises
  by {RISE_MM:g} mm{run.between(fault, run.whole)}</text>
<line class="axis" x1="{CHART}" x2="{CHART + CHART_WIDTH}" y1="{FLOOR}" y2="{FLOOR}"/>
<line class="limit" x1="{CHART}" x2="{CHART + CHART_WIDTH}" y1="{limit}" y2="{limit}"/>
<line class="target" x1="{CHART}" x2="{CHART + CHART_WIDTH}" y1="{target}" y2="{target}"/>
<text class="red" x="{CHART}" y="{limit - 6}">force limit 50 N</text>
<text class="green" x="{CHART}" y="{target - 6}">wanted 10 N</text>
<clipPath id="past"><rect x="{CHART}" y="0" height="{HEIGHT}"
  width="{CHART_WIDTH}">{run.animated("width", reveal)}</rect></clipPath>
<polyline class="force" clip-path="url(#past)" points="{line}"/>
<text class="dim" x="{CHART}" y="{FLOOR + 22}">force along the approach, {run.lasts:.1f} s</text>
<text class="red" x="{CHART}" y="30" opacity="0">stopped:
  {stop.text}{run.between(stop.at - run.began, run.whole)}</text>
<text class="ink" x="{CHART}" y="50" opacity="0">left:
  {recording.end["left"]}{run.between(run.lasts, run.whole)}</text>
</svg>
"""


def _points(places: Sequence[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in places)


def main() -> int:
    """Make the run and draw it."""
    result = hil_bridge.simulate(SETTINGS, faults=[FAULT])
    surface = read_config(SETTINGS).cell.surface
    PLACE.write_text(_picture(result.recording, surface), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
