"""List everything that nothing has exercised: conditions of the guard, faults, reactions, promises and criteria.

The evidence comes from the tests and from the runs of the guard's campaign:

    .venv/bin/python tools/check.py --all --every
    hil-bridge campaign examples/campaigns/guard.toml --output runs/guard.sqlite
    python -m tools.exercised --strike

The first command writes runs/tests/gate-exercised.json and runs/tests/full-exercised.json. With --strike, each fault
that both have left out gets a separate run first, checked against every promise of the guard. The results go to
runs/tests/struck.json.

The exit code is 1 if something is neither exercised nor a documented exception, if an exception has been exercised
after all, or if the model of the guard did not accept a run of the tests.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.devices.kinds import EmulatedKinds
from hil_bridge.errors import BridgeError, Cause
from hil_bridge.errors.cause_row import Reaction
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.lab.campaign.drawing import faults_of_cell
from hil_bridge.lab.campaign.fault_effects import fault_key, owner_of
from hil_bridge.lab.campaign.judging import run
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.lab.campaign.plan import code_version
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.invariants import Promise
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.runs.faults.wrong_controller import CONTROLLER, CONTROLLER_FAULTS
from hil_bridge.settings.configuration import load_config
from hil_bridge.settings.faults import PHASES
from tools.faults_doc import CELL, ROBOT_NAMES, SENSOR_NAMES, Job, faults_of_device, settings

ROOT = Path(__file__).resolve().parent.parent
GATE, FULL, STRUCK, CAMPAIGN = (
    ROOT / "runs" / name
    for name in (
        "tests/gate-exercised.json",
        "tests/full-exercised.json",
        "tests/struck.json",
        "guard.sqlite",
    )
)
PLAN = ROOT / "examples" / "campaigns" / "guard.toml"
CONDITIONS, REACTIONS, FAULTS, PROMISES, CRITERIA, PHASED, TARGETS = GROUPS = (
    "conditions",
    "reactions",
    "faults",
    "promises found broken",
    "criteria missed",
    "faults that the campaign draws in a phase",
    "targets that the campaign draws for a robot and a sensor",
)

_ALONE = (
    "tests/guard/test_causes_reached.py reaches the function that tells it, which the plug-in does not watch"
)
_PRESSED = "only an operator presses it: tests in real time do, in processes that the plug-in does not watch"
_PROGRAM = "no run of the bridge opens that wire; tests/emulation strikes it at the emulated robot alone"
_LEADS = "a controller is asked while the tool tracks, and in no other phase"
_CONTROLLER = tuple(fault_key(CELL, CONTROLLER, lie) for lie in CONTROLLER_FAULTS)
EXCEPTIONS: Mapping[str, str] = {
    **{f"{lie} in {phase}": _LEADS for lie in _CONTROLLER for phase in PHASES[1:] if phase != "track"},
    "zero-changed": "a force that changes within the one frame before a zero has no fault of its own",
    "retract-border": _ALONE,
    "leaves-workspace": "a program checks its path before it moves, and the clamp that it follows from is exercised",
    "output": _ALONE,
    "key": _PRESSED,
    "page": _PRESSED,
    "cut": "it is read from a file that was cut, and does not come in a run",
    "place-unknown": _ALONE,
    "rtde: robot: primary-silent": _PROGRAM,
    **{
        f"rtde: program-wire: {fault}": _PROGRAM
        for fault in (
            *("off", "mute", "deaf", "lost", "late", "twice"),
            *("corrupted", "garbled", "malformed", "reordered", "dropped"),
        )
    },
}
"""Names that need not be exercised, each with the reason."""


class Evidence(NamedTuple):
    """Names that were exercised, each with a test or run that shows it."""

    group: str
    name: str
    where: str


@dataclass(frozen=True)
class Balance:
    """Comparison of the evidence with everything that can be exercised."""

    all_names: Mapping[str, Sequence[str]]
    exercised: Mapping[str, Mapping[str, str]]
    """Evidence by group and name."""
    unaccepted: Sequence[str] = field(default=())
    """Test runs that the model of the guard did not accept."""

    def never(self, group: str) -> list[str]:
        """Return the names of a group that no test or run has exercised."""
        return [name for name in self.all_names[group] if name not in self.exercised.get(group, {})]

    def troubles(self, exceptions: Mapping[str, str]) -> Iterator[str]:
        """Return the reasons why a release must wait, one line each."""
        known = {name for names in self.all_names.values() for name in names}
        for group in GROUPS:
            for name in self.never(group):
                if name not in exceptions:
                    yield f"never exercised, of the {group}: {name}"
        for name in exceptions:
            if name not in known:
                yield f"an exception that there is not: {name}"
            elif not any(name in self.never(group) for group in GROUPS if name in self.all_names[group]):
                yield f"an exception that has been exercised: {name}"
        yield from (f"the model of the guard does not accept {one}" for one in self.unaccepted)


@cache
def all_names() -> dict[str, list[str]]:
    """Return the names of everything that can be exercised, by group."""
    devices = (*ROBOT_NAMES, *SENSOR_NAMES, CELL)
    pairs = [(robot, sensor) for robot in ROBOT_NAMES for sensor in SENSOR_NAMES]
    faults = [
        fault_key(device, on, fault)
        for device in devices
        for on, of in faults_of_device(device).items()
        for fault in of
    ]
    return {
        CONDITIONS: [str(cause) for cause in Cause],
        REACTIONS: [str(reaction) for reaction in Reaction],
        FAULTS: faults,
        PROMISES: [str(promise) for promise in Promise],
        CRITERIA: [criterion.figure for criterion in read_plan(PLAN, (1,)).criteria],
        PHASED: [f"{fault} in {phase}" for fault in (*faults, *_CONTROLLER) for phase in PHASES[1:]],
        TARGETS: [
            f"{robot}, {sensor}: {on}"
            for robot, sensor in pairs
            for on in (*EmulatedKinds.named(robot, sensor).faults, CONTROLLER)
        ],
    }


def of_tests(path: Path) -> Iterator[Evidence]:
    """Read the evidence of the tests, or of the runs of --strike."""
    evidence = _read(path)
    for group, key in (
        (CONDITIONS, "causes"),
        (FAULTS, "faults"),
        (PROMISES, "promises"),
        (CRITERIA, "criteria"),
    ):
        yield from (Evidence(group, name, where) for name, where in evidence.get(key, {}).items())


def of_campaign(path: Path) -> Iterator[Evidence]:
    """Read the evidence of a campaign's runs: causes, faults that struck, and criteria that were missed."""
    with Store.open(path) as store:
        for done in store.runs():
            where = f"seed {done.seed} of {path.name}"
            for group, key in ((CONDITIONS, "causes"), (FAULTS, "faults_struck")):
                counts = done.figures.get(key)
                yield from (
                    Evidence(group, name, where) for name in (counts if isinstance(counts, dict) else ())
                )


@cache
def of_plan(path: Path) -> tuple[Evidence, ...]:
    """Read from a campaign's own draws what it may inject: faults by phase, and targets by devices."""
    plan, cells = read_plan(path, (1,)), dict[tuple[str, str], None]()
    assert plan.draw is not None
    for case in plan.possible:
        config = config_with(case.config, "{}", 0)
        kinds = f"{config.robot.emulated}, {config.sensor.emulated}"
        for table in faults_of_cell(plan.draw, case.config):
            on, fault, phases = table["on"], table["fault"], table.get("phase", "")
            key = fault_key(owner_of(config, on, fault), on, fault)
            cells |= {(PHASED, f"{key} in {each}"): None for each in _listed(phases)}
            cells[TARGETS, f"{kinds}: {on}"] = None
    return tuple(Evidence(group, name, path.name) for group, name in cells)


def _listed(phases: object) -> Sequence[str]:
    return phases if isinstance(phases, list) else [str(phases)]


def balance(kept: Iterable[Evidence], unaccepted: Iterable[str] = ()) -> Balance:
    """Combine the evidence. Each condition of a reaction also exercises the reaction."""
    found: dict[str, dict[str, str]] = {group: {} for group in GROUPS}
    for group, name, where in kept:
        found[group].setdefault(name, where)
        if group == CONDITIONS:
            found[REACTIONS].setdefault(str(ROWS[Cause(name)].reaction), f"{name}: {where}")
    return Balance(all_names(), found, tuple(unaccepted))


def describe(found: Balance, exceptions: Mapping[str, str]) -> Iterator[str]:
    """Yield how many names of each group were exercised, and the exceptions with their reasons."""
    for group in GROUPS:
        never, count = found.never(group), len(found.all_names[group])
        yield f"{group}: {count - len(never)} of {count} exercised"
        for name in never:
            if name in exceptions:
                yield f"  never: {name} – {exceptions[name]}"


def _read(path: Path) -> dict[str, Any]:
    try:
        evidence = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BridgeError(f"cannot read {path}: {error}", remedy="make test-all writes it") from error
    if not isinstance(evidence, dict):
        raise BridgeError(f"{path} contains no evidence", remedy="make test-all writes it")
    return evidence


# --- a run for each fault that is left

QUICK: Mapping[str, object] = {
    "run.duration_s": 0.5,
    "task.retract_mm": 2.0,
    "task.retract_speed_mm_s": 11.0,
    "cell.start_position_mm": (900.0, -100.0, 591.5),
}
"""Settings with a start near the surface, so that the approach takes little time."""
AWAKE: Mapping[str, Mapping[str, object]] = {
    "jr3": {"cell.jr3.gateway.boot_s": 0.2},
    "jr3-uart": {"cell.jr3.uart.boot_s": 0.2},
    "netft": {"cell.netft.boot_s": 0.2},
}
"""Settings that shorten the start of sensors that otherwise take long to start."""
MOMENTS: Sequence[Mapping[str, object]] = (
    {"phase": "track", "after_s": 0.1},
    {"phase": "connect"},
    {"phase": "tare"},
    {"phase": "approach"},
    {"phase": "retract"},
)
"""Times of a fault, in order of preference. The first time at which the fault strikes is used."""


def strike(job: Job) -> tuple[str, str, str]:
    """Return the name of a fault, the phase in which it struck, and the promises that were then broken.

    The phase is empty if the fault did not strike, and the promises are empty if none was broken.
    """
    for moment in MOMENTS:
        given = {**settings(job), **QUICK}
        given |= AWAKE.get(str(given["sensor.emulated"]), {})
        if given["robot.emulated"] == "s3":  # an S3 runs at the pace of its line
            given = {
                key: value
                for key, value in given.items()
                if key not in ("run.period_ms", "controller.sample_ms")
            }
        injected: Mapping[str, Any] = given["faults"][0]  # type: ignore[index]
        plain = {key: value for key, value in injected.items() if key not in ("phase", "after_s")}
        try:
            figures = run(load_config(None, {**given, "faults": [{**plain, **moment}]})).figures
        except BridgeError:  # the fault cannot be injected at that time
            continue
        struck = figures.get("faults_struck")
        if isinstance(struck, dict) and job.key in struck:
            return job.key, str(moment["phase"]), json.dumps(figures.get("promises", ""))
    return job.key, "", ""


def strike_all(names: Sequence[str]) -> dict[str, Any]:
    """Run each of these faults once."""
    jobs = [Job(*name.split(": ")) for name in names]
    with own_processes() as pool:
        ends = list(in_order(pool, strike, jobs, chunk=1))
    return {
        "code": code_version(),
        "faults": {name: f"a run of its own, in {phase}" for name, phase, _ in ends if phase},
        "broken": {name: broken for name, _, broken in ends if broken not in ("", '""')},
    }


def main() -> int:
    """Read the evidence, exercise the remaining faults if requested, and print the lists."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--tests", nargs="+", type=Path, default=[GATE, FULL], metavar="FILE.json")
    options.add_argument("--campaign", nargs="*", type=Path, default=[CAMPAIGN], metavar="FILE.sqlite")
    options.add_argument("--strike", action="store_true", help="make a run for each fault not yet exercised")
    options.add_argument(
        "--other-code", action="store_true", help="accept evidence from other versions of the code"
    )
    chosen = options.parse_args()
    try:
        return _judge(chosen)
    except BridgeError as error:
        print(error, file=sys.stderr)
        return error.exit_code


def _judge(chosen: argparse.Namespace) -> int:
    files = [*chosen.tests, *([STRUCK] if STRUCK.is_file() and not chosen.strike else [])]
    kept = [one for path in files for one in of_tests(path)]
    kept += [one for path in chosen.campaign for one in of_campaign(path)]
    kept += of_plan(PLAN)
    if chosen.strike:
        struck = strike_all(balance(kept).never(FAULTS))
        STRUCK.parent.mkdir(parents=True, exist_ok=True)
        STRUCK.write_text(json.dumps(struck, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        files.append(STRUCK)
        kept += of_tests(STRUCK)
    evidence = {path: _read(path) for path in files}
    found = balance(kept, (each for one in evidence.values() for each in one.get("unaccepted", ())))
    print(*describe(found, EXCEPTIONS), sep="\n")
    if GATE in chosen.tests:
        gate = balance(of_tests(GATE))
        counts = (
            f"{len(names) - len(gate.never(group))} of {len(names)} {group}"
            for group, names in gate.all_names.items()
        )
        print(f"by the tests of the gate alone: {', '.join(counts)}")
    troubles = list(found.troubles(EXCEPTIONS))
    for path, one in evidence.items():
        troubles += [f"{name}: broken promises {words}" for name, words in one.get("broken", {}).items()]
        if one.get("code") != code_version() and not chosen.other_code:
            troubles.append(f"{path} is of another version of the code: run it again")
    for path in chosen.campaign:
        with Store.open(path) as store:
            if store.fact("code") != code_version() and not chosen.other_code:
                troubles.append(f"{path} is of another version of the code: run the campaign again")
    print(*troubles, sep="\n")
    return int(bool(troubles))


if __name__ == "__main__":
    sys.exit(main())
