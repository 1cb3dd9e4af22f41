"""Limits on the time and memory of a program.

A controller has such limits too. They are not published, so all values are chosen.
"""

TEXT_MAX = 1 << 18
"""Maximum number of characters in a program; the program of ur_rtde has 50 000."""
TOKENS_MAX = 50_000
"""Maximum number of tokens in a program; the largest of 51 public programs has 20 600."""
DEPTH_MAX = 60
"""Maximum nesting depth of blocks and expressions."""
CALLS_MAX = 40
"""Maximum nesting depth of function calls."""
THREADS_MAX = 32
"""Maximum number of concurrent threads."""
THREADS_TOGETHER = 4
"""Step budget per cycle of all threads together, as a multiple of one thread's budget."""
SOLVE_STEPS = 20
"""Number of steps charged for an inverse kinematics query."""
LENGTH_MAX = 4096
"""Maximum number of elements in a list, including the elements of nested lists."""
NESTING_MAX = 4
"""Maximum nesting depth of lists and structs."""
STRING_MAX = 16_384
"""Maximum number of characters in a string."""
MESSAGES_MAX = 256
"""Maximum number of stored messages of a program; the oldest are discarded first."""
SOCKETS_MAX = 16
"""Maximum number of open sockets."""
READS_MAX = 10
"""Maximum number of socket reads of a thread per cycle; a further read waits for the next cycle. Assumed: as many
as the maker's external control reads at once. A client that sends without a pause therefore cannot block a thread
for ever.
"""
TCP_MAX_M = 100.0
"""Maximum distance of the tool centre point from the flange along each axis, m. It is far larger than any tool, and
causes no overflow.
"""
MEMORY_MAX = 1 << 20
"""Maximum total number of list elements, struct members and string characters that a program holds."""
MEMORY_CHECK_STEPS = 1_000_000
"""Number of steps between two checks of a program's memory. A step allocates at most a hundred bytes."""
