"""Controllers from plug-ins: discovery, selection by name, and the name in errors of a faulty one."""

import subprocess
import sys
from textwrap import dedent

import pytest

from hil_bridge.control import make_controller
from hil_bridge.control.controllers import GROUP, controller_kind
from hil_bridge.errors import ConfigError
from hil_bridge.errors.plugins import plugin_names
from hil_bridge.settings.configuration import load_config

GOOD = """
    from dataclasses import dataclass
    from typing import ClassVar

    from hil_bridge.control import Command


    @dataclass(frozen=True)
    class Steady:
        name: ClassVar[str] = "steady"
        step_mm: float = 0.125

        def initial(self):
            return None

        def step(self, state, measurement, reference):
            return None, Command(measurement.commanded, 0.0)
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Put a distribution with one module and its entry points on the import path."""
    modules = []

    def put(distribution: str, module: str, code: str, **points: str) -> None:
        folder = tmp_path / distribution
        info = folder / f"{distribution}-1.2.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.2\n")
        lines = [f"{name} = {module}:{target}" for name, target in points.items()]
        (info / "entry_points.txt").write_text("\n".join(["[hil_bridge.controllers]", *lines]) + "\n")
        (folder / f"{module}.py").write_text(dedent(code))
        monkeypatch.syspath_prepend(str(folder))
        modules.append(module)

    yield put
    for module in modules:
        sys.modules.pop(module, None)


def refusal(name: str) -> str:
    with pytest.raises(ConfigError) as raised:
        make_controller(name)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_plugin_controller_is_chosen_by_name(install, tmp_path):
    install("lab", "lab_control", GOOD, steady="Steady")
    assert plugin_names(GROUP) == ["steady"]
    controller = make_controller("steady", step_mm=0.5)
    assert (type(controller).__module__, controller.step_mm) == ("lab_control", 0.5)
    path = tmp_path / "c.toml"
    path.write_text('[controller]\nname = "steady"\nparameters.step_mm = 0.25\n')
    config = load_config(path, {})
    assert make_controller(config.controller.name, **config.controller.parameters).step_mm == 0.25
    path.write_text('[controller]\nname = "steady"\nparameters.step_m = 0.25\n')
    with pytest.raises(
        ConfigError, match="steady has no parameter 'step_m'; the unit is part of the name: step_mm"
    ):
        load_config(path, {})
    path.write_text('[controller]\nname = "steady"\nparameters.step_mm = "wide"\n')
    with pytest.raises(ConfigError, match="step_mm"):
        load_config(path, {})


def test_plugin_is_imported_only_when_chosen(install):
    install("lab", "lab_control", GOOD, steady="Steady")
    make_controller("fuzzy")
    assert "steady" in refusal("clever")
    assert "lab_control" not in sys.modules
    make_controller("steady")
    assert "lab_control" in sys.modules


def test_built_in_controller_name_is_reserved(install, tmp_path):
    install("lab", "lab_control", GOOD, fuzzy="Steady")
    assert refusal("fuzzy") == "controller 'fuzzy' is built in, but lab 1.2 also provides one of that name"
    make_controller("pi")
    (tmp_path / "c.toml").write_text('[controller]\nname = "fuzzy"\n')
    with pytest.raises(ConfigError, match=r"c\.toml: controller\.name: controller 'fuzzy' is built in"):
        load_config(tmp_path / "c.toml", {})


def test_duplicate_plugin_name_is_refused(install):
    install("lab", "lab_control", GOOD, steady="Steady")
    install("shop", "shop_control", GOOD, steady="Steady")
    assert refusal("steady") == "controller 'steady' is provided by lab 1.2 and by shop 1.2; uninstall one"


@pytest.mark.parametrize(
    ("code", "target", "message"),
    [
        ("1/0", "Steady", "cannot be loaded: ZeroDivisionError: division by zero"),
        ("import no_such_thing", "Steady", "cannot be loaded: the module no_such_thing is missing"),
        ("raise RuntimeError('two\\nlines')", "Steady", "cannot be loaded: RuntimeError: two"),
        ("raise RuntimeError", "Steady", "cannot be loaded: RuntimeError"),
        (GOOD, "Other", "cannot be loaded: AttributeError"),
        ("Steady = 3", "Steady", "broken_control:Steady is not a dataclass"),
        ("class Steady: pass", "Steady", "broken_control:Steady is not a dataclass"),
        (GOOD.replace("initial", "begin"), "Steady", "has no method initial"),
        (GOOD.replace('"steady"', '"other"'), "Steady", "must have that as its attribute `name`"),
    ],
)
def test_broken_plugin_names_its_distribution(install, code, target, message):
    install("broken", "broken_control", code, steady=target)
    text = refusal("steady")
    assert text.startswith("controller 'steady' of broken 1.2")
    assert message in text
    make_controller("fuzzy")


def test_unserialisable_parameter_is_one_line_error(install, tmp_path):
    code = GOOD.replace("step_mm: float = 0.125", "lock: Lock = None").replace(
        "@dataclass", "class Lock: ...\n\n    @dataclass"
    )
    install("lab", "lab_control", code, steady="Steady")
    (tmp_path / "c.toml").write_text('[controller]\nname = "steady"\nparameters.lock = 1\n')
    with pytest.raises(ConfigError, match="steady has a parameter that no file can contain"):
        load_config(tmp_path / "c.toml", {})


def test_controller_kind_is_the_class(install):
    install("lab", "lab_control", GOOD, steady="Steady")
    assert controller_kind("steady") is sys.modules["lab_control"].Steady


def test_conformance_suite_imports_in_one_line(install, tmp_path):
    install("lab", "lab_control", GOOD, steady="Steady")
    module = tmp_path / "test_lab.py"
    module.write_text(
        dedent("""
        import pytest
        from hil_bridge.testing.controllers import *
        from lab_control import Steady

        @pytest.fixture
        def controller():
            return Steady()
        """)
    )
    where = [*sys.path, str(tmp_path / "lab")]
    run = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "--rootdir",
            str(tmp_path),
            str(module),
        ],
        env={"PYTHONPATH": ":".join(where), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    # It never moves and takes NaN for a parameter.
    failed = sorted(
        line.split("::")[1].split()[0] for line in run.stdout.splitlines() if line.startswith("FAILED")
    )
    assert failed == [
        "test_long_error_does_not_wind_up",
        "test_parameter_that_is_not_a_number_is_refused",
        "test_too_little_force_never_moves_away",
        "test_too_much_force_never_pushes_deeper",
    ], run.stdout
