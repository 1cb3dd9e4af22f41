"""Tests of URScript texts and their effects, without a moving arm."""

import math

import pytest

from emulators.devices.rtde.urscript import (
    FUNCTIONS,
    Message,
    ScriptSyntaxError,
    compile_in_steps,
    compile_program,
)
from emulators.devices.rtde.urscript.table import Support
from protocol.devices.rtde.program import force_program_text, program_text
from tests.emulation.urscript_trial import ProgramTrial, output_of, program


def failure(text: str, cycles: int = 50) -> str:
    trial = ProgramTrial(text)
    assert trial.play(cycles) >= 0
    (message,) = trial.messages(Message.RUNTIME)
    return message


VALUES = {
    "1 + 2 * 3": "7",
    "7 / 2": "3.5",
    "-7 % 3": "-1",
    "2 - -2": "4",
    "0x1F": "31",
    "1.5e2": "150",
    ".5": "0.5",
    "2147483647 + 1": "2.14748e+09",
    "True and not False": "True",
    "True xor True": "False",
    "False or 1 < 2": "True",
    "1 == 1.0": "True",
    "None": "None",
    "[1, 2, 3] * 2": "[2, 4, 6]",
    "[1, 2] + [3, 4]": "[4, 6]",
    "[1, 2] * [3, 4]": "[3, 8]",
    "-[1, 2]": "[-1, -2]",
    "[[1, 2], [3, 4]] * [1, 1]": "[3, 7]",
    "[[1, 2], [3, 4]] * [[0, 1], [1, 0]]": "[[2, 1], [4, 3]]",
    "inv([[2, 0], [0, 4]])": "[[0.5, 0], [0, 0.25]]",
    "transpose([[1, 2], [3, 4]])": "[[1, 3], [2, 4]]",
    "size([[1, 2, 3], [4, 5, 6]])": "[2, 3]",
    "[[1, 2], [3, 4]][1, 0]": "3",
    "p[1, 2, 3, 0, 0, 0][2]": "3",
    "p[1, 2, 3, 0, 0, 0]": "p[1, 2, 3, 0, 0, 0]",
    "pose_trans(p[1, 0, 0, 0, 0, d2r(90)], p[1, 0, 0, 0, 0, 0])": "p[1, 1, 0, 0, 0, 1.5708]",
    "pose_inv(p[1, 2, 3, 0, 0, 0])": "p[-1, -2, -3, 0, 0, 0]",
    "pose_sub(p[3, 2, 1, 0, 0, 0.5], p[1, 1, 1, 0, 0, 0.2])": "p[2, 1, 0, 0, 0, 0.3]",
    "pose_add(p[3, 2, 1, 0, 0, 0.5], p[1, 1, 1, 0, 0, 0.2])": "p[4, 3, 2, 0, 0, 0.7]",
    "interpolate_pose(p[0, 0, 0, 0, 0, 0], p[2, 0, 0, 0, 0, 1], 0.5)": "p[1, 0, 0, 0, 0, 0.5]",
    "point_dist(p[0, 0, 0, 1, 0, 0], p[3, 4, 0, 0, 0, 0])": "5",
    "wrench_trans(p[0, 1, 0, 0, 0, 0], [0, 0, 10, 0, 0, 0])": "[0, 0, 10, -10, 0, 0]",
    "rpy2rotvec([0, 0, 0.5])": "[0, 0, 0.5]",
    "rotvec2rpy([0.3, 0, 0])": "[0.3, 0, 0]",
    "norm([3, 4])": "5",
    "norm(-2)": "2",
    "normalize([0, 5])": "[0, 1]",
    "floor(2.7) + ceil(2.1)": "5",
    "pow(2, 10)": "1024",
    "log(10, 1000)": "3",
    "atan2(1, 1)": "0.785398",
    "r2d(d2r(30))": "30",
    "binary_list_to_integer([True, False, True])": "5",
    "integer_to_binary_list(5)[2]": "True",
    "get_list_length([1, 2])": "2",
    "make_list(3, 0)": "[0, 0, 0]",
    'str_cat("a", 2.5)': "a2.5",
    'str_at("abc", 1)': "b",
    'str_sub("abcdef", 2, 3)': "cde",
    'str_find("hello", "l")': "2",
    'str_len("four")': "4",
    'str_empty("")': "True",
    'to_num("2.5") + 1': "3.5",
    "to_str([1, True])": "[1, True]",
    "struct(a=1, b=[2, 3]).b[1]": "3",
    "[1, 2, 3, 4].slice(1, 3)": "[2, 3]",
    "time().sec": "100",
    "get_steptime()": "0.002",
    "get_tcp_offset()": "p[0, 0, 0.2, 0, 0, 0]",
    "get_inverse_kin_has_solution(p[9, 9, 9, 0, 0, 0])": "False",
    "get_digital_in(3)": "False",
    "read_input_boolean_register(64)": "False",
    'get_rtde_value("robot_mode")': "7",
}


@pytest.mark.parametrize("expression", VALUES)
def test_expressions_are_evaluated(expression: str) -> None:
    assert output_of(program(f"textmsg({expression})")) == [VALUES[expression]]


PROGRAMS = {
    "a list is handed by value": (
        "a = [1, 2]\nb = a\nb[0] = 9\ndef change(list):\n  list[1] = 7\n  return list\nend\n"
        "textmsg(a, change(a))",
        ["[1, 2][1, 7]"],
    ),
    "p is a variable, too": (
        "def scale(p):\n  p[0] = p[0] * 2\n  return p\nend\ntextmsg(scale([1, 2]))",
        ["[2, 2]"],
    ),
    "a function assigns what encloses it": (
        "x = 1\ndef up():\n  x = x + 1\nend\nup()\nup()\ntextmsg(x)",
        ["3"],
    ),
    "local hides it": ("x = 1\ndef up():\n  local x = 5\n  x = 6\nend\nup()\ntextmsg(x)", ["1"]),
    "global from inside": ("def make():\n  global y = 4\nend\nmake()\ntextmsg(y)", ["4"]),
    "defaults and names": (
        "def f(a, b=2, c=[1]):\n  return a * 100 + b * 10 + c[0]\nend\ntextmsg(f(1), to_str(f(c=[9], a=3)))",
        ["121329"],
    ),
    "a default sees where it stands": ("k = 3\ndef f(a=k + 1):\n  return a\nend\ntextmsg(f())", ["4"]),
    "recursion": (
        "def f(n):\n  if n < 2:\n    return 1\n  end\n  return n * f(n - 1)\nend\ntextmsg(f(6))",
        ["720"],
    ),
    "elif and else": (
        'def f(n):\n  if n == 1:\n    return "one"\n  elif n == 2:\n    return "two"\n  else:\n    return "more"\n'
        "  end\nend\ntextmsg(f(1), f(2))\ntextmsg(f(3))",
        ["onetwo", "more"],
    ),
    "break and continue": (
        "i = 0\nwhile True:\n  i = i + 1\n  if i == 2:\n    continue\n  end\n  if i == 4:\n    break\n  end\n"
        "  textmsg(i)\nend",
        ["1", "3"],
    ),
    "a statement continues": (
        "x = 1 +\n2\nif (x == 3) and\n  not (x == 4):\n  textmsg([1,\n 2])\nend",
        ["[1, 2]"],
    ),
    "comments and labels": ('# one\n$ 2 "Label" "noBreak"\ntextmsg("#2") # three', ["#2"]),
    "on one line": ("x = 0 while x < 2: x = x + 1 end textmsg(x)", ["2"]),
    "structs change": (
        "s = struct(a=1, b=[1, 2])\ns.a = 5\ns.b[1] = 7\ntextmsg(s)",
        ["struct(a=5, b=[1, 7])"],
    ),
    "matrices change": ("m = [[1, 2], [3, 4]]\nm[0, 1] = 9\nm[1][0] = 8\ntextmsg(m)", ["[[1, 9], [8, 4]]"]),
    "lists change": (
        "l = [1]\nl.append(2)\nl.insert(0, 0)\nl.extend([5, 6])\nl.remove(1)\nl.pop()\ntextmsg(l)",
        ["[0, 2, 5]"],
    ),
    "halt ends all": ('textmsg("a")\ndef f():\n  halt\nend\nf()\ntextmsg("b")', ["a"]),
    "or leaves the rest out": (
        'def f():\n  textmsg("called")\n  return True\nend\nif True or f():\n  textmsg("in")\nend',
        ["in"],
    ),
    "registers": (
        "write_output_integer_register(3, 5)\nwrite_output_boolean_register(40, True)\n"
        "textmsg(read_output_integer_register(3), read_output_boolean_register(40))",
        ["5True"],
    ),
    "outputs": (
        "set_digital_out(2, True)\nset_tool_digital_out(1, True)\ntextmsg(get_digital_out(2), get_tool_digital_out(1))",
        ["TrueTrue"],
    ),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_program_output(name: str) -> None:
    body, expected = PROGRAMS[name]
    assert output_of(program(body)) == expected


def test_indentation_and_function_are_optional() -> None:
    assert output_of("x = 2\nif x > 1:\ntextmsg(x)\nend\n") == ["2"]
    assert output_of('textmsg("alone")') == ["alone"]


def test_number_may_be_on_next_line() -> None:
    """As ur_rtde writes its register offset."""
    assert output_of(
        "def mine():\nglobal offset = # float register offset\n24\n  textmsg(offset)\nend\n"
    ) == ["24"]


# --- threads and time


def test_threads_run_in_order() -> None:
    text = program(
        'thread a():\n  while True:\n    textmsg("a")\n    sync()\n  end\nend\n'
        'thread b():\n  textmsg("b")\nend\n'
        'h = run a()\nk = run b()\njoin k\ntextmsg("joined")\nsync()\nsync()\nkill h\ntextmsg("killed")\nsync()'
    )
    assert output_of(text) == ["a", "b", "joined", "a", "killed"]


def test_sleep_lasts_its_time() -> None:
    assert ProgramTrial(program("sleep(0.1)")).play(100) == 50
    assert ProgramTrial(program("sync()\nsync()")).play(100) == 2
    assert ProgramTrial(program("x = 1")).play(100) == 0


def test_waiting_function_may_be_in_expression() -> None:
    text = program(
        "def f(x):\n  sync()\n  return x\nend\nif not (f(False) or f(2) < 1):\n  textmsg(f(1) + f(2) * f(3))\nend"
    )
    assert output_of(text) == ["7"]
    assert ProgramTrial(text).play(50) == 5


def test_program_ends_with_its_threads() -> None:
    text = program("thread a():\n  while True:\n    sync()\n  end\nend\nrun a()\nsync()")
    assert ProgramTrial(text).play(10) == 1


def test_kill_and_join_without_thread_do_nothing() -> None:
    assert output_of(program("h = 0\nkill h\njoin h\ntextmsg(1)")) == ["1"]


# --- errors


ERRORS = {
    "while True:\n  x = 1\nend": (2, "infinite loop"),
    "x = 1\ny = x / 0": (3, "division by zero"),
    "x = [1, 2]\nx[2] = 1": (3, "no element 2"),
    "x = [1, 2][1.5]": (2, "expected an integer"),
    'sin("a")': (2, "expected a number, got a string"),
    "x = [1].nothing()": (2, "there is no method nothing"),
    "sqrt(-1)": (2, "arithmetic"),
    "if [1]:\n  x = 1\nend": (2, "condition"),
    "def f():\n  return f()\nend\nf()": (3, "nested too deeply"),
    "thread f():\n  sync()\nend\nwhile True:\n  run f()\nend": (6, "too many threads"),
    "s = struct(a=1)\ns.b = 2": (3, "no member b"),
    "assert(1 == 2)": (2, "assertion"),
    "get_inverse_kin(p[9, 9, 9, 0, 0, 0])": (2, "no joints hold"),
    "write_output_integer_register(48, 1)": (2, "no int register 48"),
    "x = [1] + [1, 2]": (2, "do not match"),
    "x = x + 1": (2, "no value yet"),
    "inv([[1, 1], [1, 1]])": (2, "no inverse"),
}


@pytest.mark.parametrize("body", ERRORS)
def test_error_has_line(body: str) -> None:
    line, message = ERRORS[body]
    result = failure(program(body))
    assert result.startswith(f"runtime error in line {line}: ")
    assert message in result


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("def mine():\n  x = = 1\nend", 2, 7),
        ("def mine():\n  x = 1\n", 2, 8),
        ("def mine():\n  ?\nend", 2, 3),
        ("def mine():\n  break\nend", 2, 1),
        ("def mine():\n  f() = 1\nend", 2, 1),
        ("x = (1", 1, 6),
        ("x = [1]\ny = x.(2)", 2, 7),
        ("def f(a,):\nend", 1, 9),
        ("x = p[]", 1, 7),
        ("f(1, 2,)", 1, 8),
        ("x = 'a", 1, 5),
        ("end", 1, 1),
    ],
)
def test_syntax_error_has_line_and_column(text: str, line: int, column: int) -> None:
    with pytest.raises(ScriptSyntaxError) as caught:
        compile_program(text, FUNCTIONS)
    assert caught.value.failure[:2] == (line, column)


def test_function_without_effect_is_reported_once() -> None:
    trial = ProgramTrial(
        program(
            "i = 0\nwhile i < 5:\n  set_gravity([0, 0, 9])\n  set_baselight_off()\n  i = i + 1\n  sync()\nend"
        )
    )
    assert trial.play(20) == 5
    counts = {"URScript set_gravity()": 1, "URScript set_baselight_off()": 1}
    assert trial.controller.unmodelled.counts == counts


TAGGED_CALLS = [
    'modbus_add_signal("10.0.0.9", 255, 4, 3, "several", True, 8)',
    'modbus_add_rw_signal("10.0.0.9", 255, 4, 8, 20, 8, "both")',
    'modbus_set_signal_watchdog("several", 7.5)',
    'modbus_set_output_register("several", [1, 2, 3])',
    'modbus_set_runstate_dependent_choice("coil", 0)',
    "write_port_register(130, read_port_register(129))",
    "encoder_enable_set_tick_count(0, 2)",
    "track_conveyor_linear(p[0, 1, 0, 0, 0, 0], 2000)",
    "path_offset_set(p[0, 0, 0.01, 0, 0, 0], 1)",
    "pause_on_error_code(153)",
    "get_jacobian([0, 0, 0, 0, 0, 0], p[0, 0, 0.1, 0, 0, 0])",
    "get_jacobian_time_derivative([0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0])",
    "get_mass_matrix([0, 0, 0, 0, 0, 0], True)",
    "get_coriolis_and_centrifugal_torques(get_actual_joint_positions(), get_actual_joint_speeds())",
]
"""Calls allowed by the manual, of functions without effect here."""


@pytest.mark.parametrize("call", TAGGED_CALLS)
def test_tagged_function_accepts_documented_call(call: str) -> None:
    trial = ProgramTrial(program(call))
    assert trial.play(5) >= 0
    assert trial.messages(Message.RUNTIME) == []
    assert f"URScript {call.partition('(')[0]}()" in trial.controller.unmodelled.counts


def test_arm_dynamics_are_reported_as_zero() -> None:
    """Elements of the matrices as `rtde_control.script` of ur_rtde 1.6.5 reads them."""
    body = (
        "m = get_mass_matrix()\nj = get_jacobian()\nt = get_jacobian_time_derivative()\n"
        "c = get_coriolis_and_centrifugal_torques()\ntextmsg(m[5, 5] + j[0, 5] + t[5, 0] + c[5])"
    )
    trial = ProgramTrial(program(body))
    assert trial.play(5) >= 0
    assert trial.messages(Message.TEXT) == ["0"]
    details = {one.thing: one.detail for one in trial.controller.unmodelled.things}
    assert details["URScript get_mass_matrix()"] == "always gives the same answer"
    assert len(details) == 4


def test_tool_centre_point_out_of_bounds_ends_program() -> None:
    """At 1e308 m every position overflowed, and a panel printed 300 digits."""
    reported = failure(program("set_tcp(p[0, -1e308, 0, 0, 0, 0])"))
    assert reported == "runtime error in line 2: a tool centre point must be at most 100 m from the flange"


@pytest.mark.parametrize("call", ["set_payload(-3)", "set_payload_mass(-3)"])
def test_negative_payload_stops_program(call: str) -> None:
    assert failure(program(call)) == "runtime error in line 2: a payload must be at least 0 kg, got -3 kg"


def test_interpreter_mode_reports_missing_port() -> None:
    trial = ProgramTrial(program("interpreter_mode()"))
    trial.play(5)
    (reported,) = trial.controller.unmodelled.things
    assert reported.detail == "returns at once: port 30020 is not served"


def test_missing_modbus_unit_has_error() -> None:
    body = 'modbus_add_signal("10.0.0.9", 255, 0, 1, "coil")\ntextmsg(modbus_get_error("coil") == 0)'
    assert output_of(program(body)) == ["False"]


NOT_COMPILED = {
    "if False:\n  textmsg(nothing)\nend": (3, 13, "compile_error_name_not_found:nothing:"),
    "thread t():\n  unheard_of(1)\nend": (3, 5, "compile_error_name_not_found:unheard_of:"),
    "x = y": (2, 7, "compile_error_name_not_found:y:"),
    "run nobody()": (2, 7, "compile_error_name_not_found:nobody:"),
    "sin(1, 2)": (2, 3, "sin takes 1 arguments"),
    "movej()": (2, 3, "movej needs the argument q"),
    "movej([0,0,0,0,0,0], speed=1)": (2, 3, "unknown or repeated argument speed of movej"),
    "def f(a):\n  return a\nend\nf()": (5, 3, "f needs the argument a"),
    'x = rpc_factory("xmlrpc", "http://10.0.0.1")\nx.go(speed=1)': (
        3,
        8,
        "methods take no named arguments, got speed",
    ),
}


@pytest.mark.parametrize("body", NOT_COMPILED)
def test_uncompilable_text_has_location(body: str) -> None:
    with pytest.raises(ScriptSyntaxError) as caught:
        compile_program(program(body), FUNCTIONS)
    assert caught.value.failure[:3] == NOT_COMPILED[body]


def test_compilation_takes_one_step_per_statement() -> None:
    """One for parsing, and one for compiling: a long text blocks its device no longer than one statement does."""
    body = "if True:\n  x = [1, 2, 3]\n  while x[0] > 1:\n    sync()\n  end\nend\n" * 200
    text = program("local x = 1\n" + body)
    assert sum(1 for _ in compile_in_steps(text, FUNCTIONS)) == pytest.approx(2 * (4 * 200 + 1), abs=3)


def test_same_text_is_compiled_once() -> None:
    text = program("x = 12345.678")
    made = compile_program(text, FUNCTIONS)
    assert list(compile_in_steps(text, FUNCTIONS)) == []
    assert compile_program(text, FUNCTIONS) is made
    assert compile_program(text, dict(FUNCTIONS)) is not made


def test_only_newest_programs_are_kept() -> None:
    first = compile_program(program("x = 1"), FUNCTIONS)
    for number in range(8):
        compile_program(program(f"x = 1.{number}"), FUNCTIONS)
    assert compile_program(program("x = 1"), FUNCTIONS) is not first


def test_built_in_programs_compile() -> None:
    assert compile_program(program_text(50, 10.0, 2.0, 0.3), FUNCTIONS).name == "hil_bridge"
    assert compile_program(force_program_text(True), FUNCTIONS).name == "hil_ft"


def test_any_call_returns_value_or_error() -> None:
    """Functions raise nothing but errors of the program, whatever their arguments."""
    arguments: tuple[str, ...] = (
        "1",
        '"a"',
        "[1, 2]",
        "None",
        "True",
        "p[0, 0, 0, 0, 0, 0]",
        "[[1]]",
        "1e308",
    )
    for name, function in FUNCTIONS.items():
        for value in arguments:
            trial = ProgramTrial(program(f"{name}({', '.join([value] * len(function.parameters))})"))
            trial.play(3)


def test_tables_describe_support_of_functions() -> None:
    supports = [function.support for function in FUNCTIONS.values()]
    assert supports.count(Support.MODELLED) > 100
    assert supports.count(Support.TAGGED) > 50
    assert FUNCTIONS["movel"].signature == "movel(pose, a=1.2, v=0.25, t=0, r=0)"


def test_non_finite_numbers_do_not_reach_arm() -> None:
    trial = ProgramTrial(program("x = 1e308 * 10\nmovel(p[x, 0, 0, 0, 0, 0])"))
    assert trial.play(5) >= 0
    assert math.isfinite(max(trial.controller.arm.joints))
    assert "not a number" in trial.messages(Message.RUNTIME)[0]
