"""Tables 1 to 3 of the paper and the rules behind Table 3.

Source: "A Fuzzy Adaptive Control Design for Compliant Motion of a Manipulator" (IEEE, 1994). The printed tables were
repaired where the scan is damaged. The rules are not printed; they were recovered by searching for the set whose
inference reproduces Table 3. Errors and changes are percent of the desired force; levels run from −6 to +6.
"""

LEVELS = tuple(range(-6, 7))
"""The 13 levels of both inputs and of the output. One output level is one resolution step of the robot."""

ERROR_EDGES_PERCENT = (-51.0, -41.0, -31.0, -21.0, -5.0, -1.0, 1.0, 5.0, 21.0, 31.0, 41.0, 51.0)
"""Table 1, left: edges between neighbouring levels of the force error, percent."""

CHANGE_EDGES_PERCENT = (-25.0, -20.0, -15.0, -10.0, -5.0, -0.5, 0.5, 5.0, 10.0, 15.0, 20.0, 25.0)
"""Table 1, right: edges between neighbouring levels of the change of the force error, percent."""

MEMBERSHIPS = {
    "NB": (1.0, 0.7, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "NM": (0.3, 0.7, 1.0, 0.7, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "NS": (0.0, 0.0, 0.3, 0.7, 1.0, 0.7, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "ZO": (0.0, 0.0, 0.0, 0.0, 0.3, 0.7, 1.0, 0.7, 0.3, 0.0, 0.0, 0.0, 0.0),
    "PS": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.7, 1.0, 0.7, 0.3, 0.0, 0.0),
    "PM": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.7, 1.0, 0.7, 0.3),
    "PB": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.7, 1.0),
}
"""Table 2: degree to which each level belongs to a linguistic value, with one number per level."""

GAIN_MATRIX = (
    (5, 5, 5, 5, 5, 5, 4, 4, 3, 2, 1, 0, 0),
    (5, 5, 5, 4, 4, 4, 4, 3, 2, 2, 1, 0, 0),
    (5, 5, 4, 4, 3, 3, 3, 2, 1, 1, 0, -1, -1),
    (5, 4, 4, 3, 3, 3, 2, 2, 1, 0, -1, -2, -2),
    (5, 4, 3, 3, 2, 2, 1, 1, 0, -1, -1, -2, -3),
    (4, 4, 3, 3, 2, 1, 0, 0, -1, -2, -2, -3, -3),
    (3, 3, 3, 2, 1, 0, 0, 0, -1, -2, -3, -3, -3),
    (3, 3, 2, 2, 1, 0, 0, -1, -2, -3, -3, -4, -4),
    (3, 2, 1, 1, 0, -1, -1, -2, -2, -3, -3, -4, -5),
    (2, 2, 1, 0, -1, -2, -2, -3, -3, -3, -4, -4, -5),
    (1, 1, 0, -1, -1, -2, -3, -3, -3, -4, -4, -5, -5),
    (0, 0, -1, -2, -2, -3, -4, -4, -4, -4, -5, -5, -5),
    (0, 0, -1, -2, -3, -4, -5, -5, -5, -5, -5, -5, -5),
)
"""Table 3: output level. Rows are the error levels from −6 to +6, columns the change levels from −6 to +6."""

RULES = {
    "NB": ("PB", "PB", "PB", "PB", "PM", "PS", "ZO"),
    "NM": ("PB", "PB", "PM", "PM", "PS", "ZO", "NS"),
    "NS": ("PB", "PM", "PS", "PS", "ZO", "NS", "NM"),
    "ZO": ("PM", "PM", "PS", "ZO", "NS", "NM", "NM"),
    "PS": ("PM", "PS", "ZO", "NS", "NS", "NM", "NB"),
    "PM": ("PS", "ZO", "NS", "NM", "NM", "NB", "NB"),
    "PB": ("ZO", "NS", "NM", "NB", "NB", "NB", "NB"),
}
"""Linguistic values of the output. Keys are the values of the error; columns are the values of its change in the
order NB, NM, NS, ZO, PS, PM, PB.

Derived: Mamdani inference on these rules reproduces 168 of the 169 entries of Table 3.
"""
