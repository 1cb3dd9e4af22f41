"""Bounds of a program, so that no text takes all time or memory. A controller has such bounds too; its own are not
published, so all of these are chosen.
"""

TEXT_MAX = 1 << 18
"""Characters of a text; ur_rtde's has 50 000."""
DEPTH_MAX = 60
"""Nested blocks and expressions."""
CALLS_MAX = 40
"""Functions that have called each other."""
THREADS_MAX = 32
"""Threads at a time."""
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
