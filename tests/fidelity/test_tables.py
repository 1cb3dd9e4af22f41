"""Tables as other programs write them: read, or refused with the line number; nothing is guessed."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.tables import Table, read_table
from hil_bridge.lab.fidelity.units import ROTATION, plain_unit, split_heading

PRESS = 'press = { columns = ["f"], unit = "N" }'
COUNT = 60


def table_of(
    folder: Path, content: str | bytes, columns: str = PRESS, time: str = 'column = "t"', top: str = ""
) -> Table:
    """Return the table of a file with a mapping."""
    file, mapping = folder / "log.csv", folder / "map.toml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    mapping.write_text(f"{top}\n[time]\n{time}\n[columns]\n{columns}\n", encoding="utf-8")
    return read_table(file, mapping)


def refusal(folder: Path, content: str | bytes, *more: str, **settings: str) -> str:
    """Return the one-line error for a file."""
    with pytest.raises(ConfigError) as caught:
        table_of(folder, content, *more, **settings)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 500
    return text


def text_of(header: str = "t,f", separator: str = ",", rows: Sequence[Sequence[str]] = ()) -> str:
    """Return a table with times in steps of 0.01 and forces that rise by 0.5."""
    rows = rows or [(f"{k / 100}", f"{k / 2}") for k in range(COUNT)]
    return "\n".join([header, *(separator.join(row) for row in rows)]) + "\n"


def with_row(line: int, *cells: str) -> list[Sequence[str]]:
    """Return the usual rows with the row of one line replaced."""
    rows: list[Sequence[str]] = [(f"{k / 100}", f"{k / 2}") for k in range(COUNT)]
    rows[line - 2] = cells
    return rows


def check_usual(table: Table) -> None:
    """Check for the usual values."""
    assert table.times == pytest.approx(np.arange(COUNT) / 100)
    assert table.columns["press"] == pytest.approx(np.arange(COUNT) / 2)
    assert table.notes == ()


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_byte_order_mark_selects_encoding(tmp_path: Path, encoding: str) -> None:
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    check_usual(table_of(tmp_path, (mark + text_of()).replace("\n", "\r\n").encode(encoding)))


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_decimal_comma_is_read(tmp_path: Path, separator: str) -> None:
    check_usual(table_of(tmp_path, text_of(separator.join("tf"), separator).replace(".", ",")))


def test_quoted_decimal_comma_is_read(tmp_path: Path) -> None:
    rows = [(f'"{k / 100}"'.replace(".", ","), f'"{k / 2}"'.replace(".", ",")) for k in range(COUNT)]
    check_usual(table_of(tmp_path, text_of(rows=rows)))


def test_ambiguous_comma_is_refused(tmp_path: Path) -> None:
    rows = [(str(k), "1,234") for k in range(COUNT)]
    text = text_of("t;f", ";", rows)
    assert "line 2: press: '1,234': the comma may be a thousands separator" in refusal(tmp_path, text)
    assert table_of(tmp_path, text, top='decimal = ","').columns["press"][0] == 1.234
    assert "press in line 2 is not a number: '1,234'" in refusal(tmp_path, text, top='decimal = "."')
    mixed = text_of("t;f", ";", [("0.5", "1,5"), *rows])
    assert "and other cells have a point, such as '0.5'" in refusal(tmp_path, mixed)


def test_unquoted_decimal_comma_between_commas_is_refused(tmp_path: Path) -> None:
    assert "line 2 has 4 cells, and the header 2" in refusal(tmp_path, text_of().replace(".", ","))
    assert "line 3 has 3 cells" in refusal(tmp_path, text_of(rows=with_row(3, "0.01", "0", "5")))


def test_unclosed_quote_is_refused(tmp_path: Path) -> None:
    rows = [(f"{k / 100}", f"{k / 2}", '"ok"' if k != 70 else '"ok') for k in range(150)]
    assert "line 72: not a table: unclosed quote" in refusal(tmp_path, text_of("t,f,note", rows=rows))


def test_overflowing_value_is_refused_by_quantity(tmp_path: Path) -> None:
    table = table_of(tmp_path, text_of(rows=with_row(4, "0.02", "1e307")), PRESS.replace('"N"', '"kN"'))
    with pytest.raises(ConfigError, match="press reaches inf N"):
        table.check()


@pytest.mark.parametrize("number", ["1_000", "1e999", "0x10", "--1", "1 5"])
def test_python_only_number_format_is_refused(tmp_path: Path, number: str) -> None:
    assert f"press in line 4 is not a number: '{number}'" in refusal(
        tmp_path, text_of(rows=with_row(4, "0.02", number))
    )


def test_lines_before_header_are_skipped(tmp_path: Path) -> None:
    front = 'Test bench 7\nOperator; "unknown\n\n# rate, 100 Hz\n'
    check_usual(table_of(tmp_path, front + text_of()))
    check_usual(table_of(tmp_path, "# " + text_of()))
    bad = front + text_of(rows=with_row(4, "0.02", "x"))
    assert "press in line 8 is not a number" in refusal(tmp_path, bad)
    lines = text_of().split("\n")
    lines[2] = lines[2] + "\n\n"
    check_usual(table_of(tmp_path, "\n".join(lines)))
    numbered = "# t f\n" + text_of().partition("\n")[2]
    mapping = 'press = { columns = [2], unit = "N" }'
    check_usual(table_of(tmp_path, numbered, mapping, "column = 1", "header = false"))


def test_ambiguous_column_name_is_refused(tmp_path: Path) -> None:
    rows = [(f"{k / 100}", "1", "2") for k in range(COUNT)]
    text = text_of("t,f,f", rows=rows)
    assert "columns 2 and 3 are both named 'f'; give the column's number" in refusal(tmp_path, text)
    third = 'press = { columns = [3], unit = "N" }'
    assert table_of(tmp_path, text, third).columns["press"][0] == 2.0


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("2024-01-20T21:25:16.{:02d}", 0.01),
        ("2024-01-20 21:25:16,{:02d}00", 0.01),
        ("20240120T2125{:02d}Z", 1.0),
        ("2024-01-20T21:25:16.{:02d}+05:30", 0.01),
    ],
)
def test_iso_times_are_read(tmp_path: Path, cell: str, seconds: float) -> None:
    rows = [(cell.format(k), "1.5") for k in range(COUNT)]
    table = table_of(tmp_path, text_of("t;f", ";", rows))
    assert table.times == pytest.approx(np.arange(COUNT) * seconds, abs=1e-6)


def test_iso_times_of_different_zones_are_converted(tmp_path: Path) -> None:
    rows = [(f"2024-01-20T21:25:{k:02d}Z", "1") for k in range(COUNT)]
    rows[7] = ("2024-01-20T22:25:07+01:00", "1")
    assert table_of(tmp_path, text_of(rows=rows)).times[7] == 7.0


@pytest.mark.parametrize(
    ("line", "cell", "message"),
    [
        (5, "2024-01-20T21:25:03", "line 5: '2024-01-20T21:25:03' is mixed with times with a zone"),
        (5, "2024-01-20T21:25:61Z", "line 5: '2024-01-20T21:25:61Z' is not an ISO 8601 time"),
        (5, "0.03", "line 5: '0.03' is not an ISO 8601 time"),
        (2, "20.01.2024 21:25:00", "time in line 2 is not a number: '20.01.2024 21:25:00'"),
        (2, "21:25:00", "time in line 2 is not a number: '21:25:00'"),
    ],
)
def test_mixed_time_formats_are_refused(tmp_path: Path, line: int, cell: str, message: str) -> None:
    rows = [(f"2024-01-20T21:25:{k:02d}Z", "1") for k in range(COUNT)]
    rows[line - 2] = (cell, "1")
    assert message in refusal(tmp_path, text_of(rows=rows))


def test_iso_times_mixed_with_numbers_are_refused(tmp_path: Path) -> None:
    rows = [(f"2024-01-20T21:25:{k:02d}Z", "1") for k in range(COUNT)]
    text = text_of(rows=rows)
    assert "remove time.unit" in refusal(tmp_path, text, time='column = "t"\nunit = "ms"')
    (tmp_path / "other.csv").write_text(text_of("t,d"))
    other = PRESS + '\ndepth = { columns = ["d"], unit = "m", file = "other.csv" }'
    assert "other.csv has numbers, and log.csv times with a zone" in refusal(tmp_path, text, other)


@pytest.mark.parametrize(
    ("heading", "size"),
    [
        ("f [lbf]", 4.4482216152605),
        ("f (N)", 1.0),
        ("f[kN]", 1e3),
        ("f_z_uN", 1e-6),
        ("f_µN", 1e-6),
        ("f [μN]", 1e-6),
        ("f (kgf)", 9.80665),
        ("f [ozf]", 0.27801385095378125),
    ],
)
def test_header_unit_is_used_and_reported(tmp_path: Path, heading: str, size: float) -> None:
    name = split_heading(heading)[0]
    table = table_of(tmp_path, text_of(f"t,{heading}"), f'press = {{ columns = ["{name}"] }}')
    assert table.columns["press"][2] == pytest.approx(size, rel=1e-15)
    assert table.notes == (f"{tmp_path / 'log.csv'}: by its header press in {split_heading(heading)[1]}",)


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        ("in-lbf", 0.1129848290276167),
        ("lbf ft", 1.3558179483314004),
        ("mNm", 1e-3),
        ("Nmm", 1e-3),
        ("N*m", 1.0),
        ("uN.m", 1e-6),
        ("kgf·cm", 0.0980665),
    ],
)
def test_moment_unit_is_converted(tmp_path: Path, unit: str, size: float) -> None:
    mapping = f'moment = {{ columns = ["f", "", ""], unit = "{unit}" }}'
    assert table_of(tmp_path, text_of(), mapping).columns["mx"][2] == pytest.approx(size, rel=1e-14)


def test_unit_line_below_header_is_used(tmp_path: Path) -> None:
    text = text_of("t,f\nms,lbf")
    table = table_of(tmp_path, text, 'press = { columns = ["f"] }')
    assert table.times[1] == pytest.approx(1e-5)
    assert table.columns["press"][2] == pytest.approx(4.4482216152605)
    assert table.notes == (f"{tmp_path / 'log.csv'}: by its header time in ms, press in lbf",)
    assert "press is in lbf by its header and in N by the mapping" in refusal(tmp_path, text)


def test_contradictory_unit_is_refused(tmp_path: Path) -> None:
    assert "press is in lbf by its header and in N" in refusal(tmp_path, text_of("t,f [lbf]"))
    assert "time is in ms by its header and in s" in refusal(
        tmp_path, text_of("t (ms),f"), time='column = "t"\nunit = "s"'
    )
    by_number = 'press = { columns = [2], unit = "N" }'
    check_usual(table_of(tmp_path, text_of("t,f [lbf]"), by_number))
    check_usual(table_of(tmp_path, text_of("t,f [sum]"), PRESS))
    assert "names no known unit of press, got 'f [V]'; set unit" in refusal(
        tmp_path, text_of("t,f [V]"), 'press = { columns = ["f"] }'
    )
    assert table_of(tmp_path, text_of("t [ms],f")).times[1] == pytest.approx(1e-5)


def test_counts_need_a_factor(tmp_path: Path) -> None:
    output = refusal(tmp_path, text_of(), 'press = { columns = ["f"], unit = "counts" }')
    assert 'columns.press is in counts; set unit = "N" and factor = N per count' in output
    assert "press is in counts; set" in refusal(
        tmp_path, text_of("t,f [counts]"), 'press = { columns = ["f"] }'
    )
    scaled = 'press = { columns = ["f"], unit = "mN", factor = 20, sign = -1 }'
    assert table_of(tmp_path, text_of("t,f [counts]"), scaled).columns["press"][2] == pytest.approx(-0.02)
    each = 'force = { columns = ["f", "", "f"], unit = "N", factor = [0.5, 1, 2] }'
    table = table_of(tmp_path, text_of(), each)
    assert (table.columns["fx"][2], table.columns["fz"][2]) == (0.5, 2.0)
    for factor, text in (
        ("0", "must be a number other than 0, got 0"),
        ("nan", "other than 0, got nan"),
        ("[1, 2]", "must be one number, or 1, got 2"),
    ):
        mapping = f'press = {{ columns = ["f"], unit = "N", factor = {factor} }}'
        assert text in refusal(tmp_path, text_of(), mapping)
    assert "factor requires columns.press.unit" in refusal(
        tmp_path, text_of(), 'press = { columns = ["f"], factor = 2 }'
    )


def test_rows_with_blank_cells_are_skipped_and_counted(tmp_path: Path) -> None:
    rows = with_row(5, "0.03", " ")
    rows[7] = ("", "")
    table = table_of(tmp_path, text_of(rows=rows))
    assert len(table.times) == COUNT - 2
    assert 1.5 not in table.columns["press"]
    assert table.times[3] == pytest.approx(0.04)
    assert [note.partition(": ")[2] for note in table.notes] == [
        "2 of 60 rows skipped for blank cells, the first in line 5: time in 1, press in 2"
    ]
    even = table_of(tmp_path, text_of(rows=rows), time="rate_hz = 100")
    assert even.times[3] == pytest.approx(0.04)
    empty = [(f"{k / 100}", "") for k in range(COUNT)]
    assert "60 of 60 rows skipped for blank cells" in refusal(tmp_path, text_of(rows=empty))


def test_duplicate_times_keep_first_row(tmp_path: Path) -> None:
    rows = with_row(5, "0.02", "99")
    table = table_of(tmp_path, text_of(rows=rows))
    assert 99.0 not in table.columns["press"]
    assert table.columns["press"][2] == 1.0
    assert "1 of 60 rows skipped for the same time as the previous row, the first in line 5" in table.notes[0]
    coarse = [(f"{k // 3}", "1") for k in range(90)]
    assert "has 30 different times in 90 rows" in refusal(tmp_path, text_of(rows=coarse))
    assert "the time decreases in line 5; sort" in refusal(tmp_path, text_of(rows=with_row(5, "0.01", "1")))


@pytest.mark.parametrize("names", ["qx,qy,qz,qw", "qw,qx,qy,qz", "o.w,o.z,o.y,o.x"])
def test_quaternion_becomes_a_rotation(tmp_path: Path, names: str) -> None:
    turns = Rotation.from_euler("xyz", np.column_stack([np.linspace(0.0, 1.0, COUNT)] * 3) * [1.0, 2.0, 3.0])
    order = ["xyzw".index(name[-1]) for name in names.split(",")]
    rows = [(f"{k / 100}", *(f"{v:.4f}" for v in turns.as_quat()[k][order])) for k in range(COUNT)]
    listed = ", ".join(f'"{name}"' for name in names.split(","))
    table = table_of(tmp_path, text_of(f"t,{names}", rows=rows), f"rotation = {{ columns = [{listed}] }}")
    expected = turns.as_matrix().reshape(-1, 9)
    for k, part in enumerate(ROTATION):
        assert table.columns[part] == pytest.approx(expected[:, k], abs=3e-4)
    rows[3] = (rows[3][0], "0", "0", "0", "0")
    text = "the quaternion in line 5 is invalid: its length is not 1"
    assert text in refusal(
        tmp_path, text_of(f"t,{names}", rows=rows), f"rotation = {{ columns = [{listed}] }}"
    )


@pytest.mark.parametrize("columns", ['["q1", "q2", "q3", "q4"]', "[2, 3, 4, 5]", '["ax", "y", "z", "w"]'])
def test_quaternion_without_component_order_is_refused(tmp_path: Path, columns: str) -> None:
    output = refusal(tmp_path, text_of(), f"rotation = {{ columns = {columns} }}")
    assert "must have a common name ending in x, y, z and w" in output


def test_table_notes_go_to_stderr(tmp_path: Path) -> None:
    rows = [(f"{k / 100}", f"{math.sin(k / 30):.4f}") for k in range(400)]
    rows[9] = (rows[9][0], "")
    (tmp_path / "log.csv").write_text(text_of("t,q [rad]", rows=rows))
    (tmp_path / "map.toml").write_text(
        '[time]\ncolumn = "t"\n[columns]\ntarget_q = { columns = ["q", "", "", "", "", ""] }\n'
        'q = { columns = ["q", "", "", "", "", ""], unit = "rad" }\n'
    )
    for command in (["identify", "fidelity", "--as", "rtde", "--json"], ["identify", "cell", "--json"]):
        result = CliRunner().invoke(
            cli, [*command, str(tmp_path / "log.csv"), "--columns", str(tmp_path / "map.toml")]
        )
        assert result.exit_code == 0, result.exception
        assert result.stdout.startswith("{")
        assert "by its header target_q1" in result.stderr
        assert "1 of 400 rows skipped for blank cells" in result.stderr


def test_unit_spellings_are_equivalent() -> None:
    assert {plain_unit(text) for text in ("Nm", "N*m", "N-m", "N m", " N · m ", "N.m")} == {"N·m"}
    assert split_heading("q_1") == ("q_1", "", False)
    assert split_heading("force[0]") == ("force", "", True)
