"""Suites of tests for what others write: controllers and wires. A test module imports one and gives it a fixture.

They need pytest: `pip install 'hil-bridge[testing]'`.
"""

try:
    import pytest
except ImportError as error:
    raise ImportError("hil_bridge.testing needs pytest; install hil-bridge[testing]") from error

# an assertion that fails then shows its values, as in a test module
pytest.register_assert_rewrite(
    *(f"{__name__}.{name}" for name in ("controllers", "datagrams", "ends", "streams"))
)
