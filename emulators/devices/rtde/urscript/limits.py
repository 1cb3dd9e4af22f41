"""Bounds of a program, so that no text takes all time or memory. A controller has such bounds too; its own are not
published, so all of these are chosen.
"""

TEXT_MAX = 1 << 18
"""Characters of a text; ur_rtde's has 50 000."""
TOKENS_MAX = 50_000
"""Words, signs and numbers of a text; the largest of 51 public programs has 20 600."""
DEPTH_MAX = 60
"""Nested blocks and expressions."""
CALLS_MAX = 40
"""Functions that have called each other."""
THREADS_MAX = 32
"""Threads at a time."""
THREADS_TOGETHER = 4
"""All threads of a program take as many steps in a cycle as so many may alone."""
SOLVE_STEPS = 20
"""Steps of one question of inverse kinematics."""
LENGTH_MAX = 4096
"""Elements of a list, those of its elements counted too."""
NESTING_MAX = 4
"""Lists and structs in each other."""
STRING_MAX = 16_384
"""Characters of a string."""
MESSAGES_MAX = 256
"""Messages of a program that are kept; of more the oldest go."""
SOCKETS_MAX = 16
"""Open sockets."""
READS_MAX = 10
"""Reads of sockets by a thread in one cycle; the next one waits for the next cycle. Assumed: as many as the maker's
external control reads at once. So a client that sends without a pause cannot keep a thread from its end.
"""
TCP_MAX_M = 100.0
"""Distance of the tool centre point from the flange along each axis, m: far beyond any tool, and no place overflows."""
MEMORY_MAX = 1 << 20
"""Elements of lists and structs, and characters of strings, that a program keeps at a time."""
MEMORY_LOOK_STEPS = 1_000_000
"""Steps of a program between two looks at what it keeps. A step makes a hundred bytes at most."""
