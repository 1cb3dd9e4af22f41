"""Requirements against tests: a list of them, results of tests as JUnit files, and the matrix of both."""

from hil_bridge.lab.requirements.matrix import Matrix, Requirement, Row, State, Tried, matrix_of
from hil_bridge.lab.requirements.reading import read_digests, read_requirements, read_tests
from hil_bridge.lab.requirements.telling import as_csv, as_page, describe

__all__ = [
    "Matrix",
    "Requirement",
    "Row",
    "State",
    "Tried",
    "as_csv",
    "as_page",
    "describe",
    "matrix_of",
    "read_digests",
    "read_requirements",
    "read_tests",
]
