"""`hil-bridge requirements`: which test shows which requirement."""

from datetime import UTC, datetime
from pathlib import Path

import click

from hil_bridge.cli.options import overwrite_option, tell
from hil_bridge.cli.paths import FILE

NOT_SHOWN = 4
"""Exit code where a requirement has not passed: that of a criterion that was not met."""


@click.command(short_help="Tell which test shows which requirement.")
@click.argument("requirements_file", metavar="REQUIREMENTS.csv", type=FILE)
@click.argument("results", metavar="JUNIT.xml…", type=FILE, nargs=-1, required=True)
@click.option("--page", type=FILE, metavar="FILE.html", help="Write the matrix as a page.")
@click.option("--csv", "table", type=FILE, metavar="FILE.csv", help="Write the matrix as a table.")
@overwrite_option
def requirements(
    requirements_file: Path, results: tuple[Path, ...], page: Path | None, table: Path | None, overwrite: bool
) -> None:
    """Lay a list of requirements against results of tests: requirement, test, verdict, recording.

    \b
    pytest --junitxml tests.xml
    hil-bridge requirements requirements.csv tests.xml --page matrix.html

    REQUIREMENTS.csv has the columns id and text. A test names a requirement by @pytest.mark.hil_requirement("R-12"),
    or a JUnit file of any other tool by the property hil_requirement. The exit code is 4 where a requirement has not
    passed, has no test, or is not in the list.
    """
    from hil_bridge.errors.text_files import harmless
    from hil_bridge.lab.campaign.plan import code_version
    from hil_bridge.lab.requirements import (
        as_csv,
        as_page,
        describe,
        matrix_of,
        read_digests,
        read_requirements,
        read_tests,
    )
    from hil_bridge.record.files import check_place, write_whole

    for path in (page, table):
        if path is not None:
            check_place(path, overwrite)
    wanted = read_requirements(requirements_file)
    matrix = matrix_of(wanted, [test for path in results for test in read_tests(path)])
    if page is not None:
        facts = (
            ("Date", f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC"),
            ("Software", f"hil-bridge {code_version()}"),
            *((f"SHA-256 of {name}", digest) for name, digest in read_digests((requirements_file, *results))),
        )
        write_whole(
            page, as_page(f"Requirements of {requirements_file.name}", matrix, page, facts), overwrite
        )
    if table is not None:
        write_whole(table, as_csv(matrix), overwrite)
    tell(harmless(line) for line in describe(matrix))
    if not matrix.shown:
        click.get_current_context().exit(NOT_SHOWN)
