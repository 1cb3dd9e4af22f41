"""Known facts of the CAN gateway as transcripts, one for every statement.

A line is milliseconds since power-up, direction (`>` to the gateway, `<` from it) and frame; `! unplug` and `! plug_in`
are the sensor's plug. Frames are written out; `sample N`, `zeros N` and `filtered N HZ` denote the force and the moment
frame with counter N of a sensor that reads 1000 −2000 3000 400 −500 600 counts.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Transcript:
    """Statement about the gateway, and the bus traffic that shows it."""

    sentence: str
    lines: str
    connected: bool = True


TRANSCRIPTS = [
    Transcript(
        "after power-up 2 s of silence, then, once the calibration is read, boot-up",
        """
        1999   > 401#
        2033   < 701#
        2100   > 401#
        2100   < 101#00
        """,
    ),
    Transcript(
        "commands that come while the calibration is read wait for it",
        """
        2010   > 401#
        2010   > 481#
        2033   < 701#
        2033   < 101#00
        2033   < 101#0073006F00B900
        """,
    ),
    Transcript(
        "without a sensor no boot-up, acknowledges carry 1 and commands have no effect",
        """
        2500   > 401#
        2500   < 101#01
        2600   > 201#000010270000
        2600   < 101#01
        2700   > 080#
        2800   > 301#
        2800   < 101#01
        2900   > 481#
        2900   < 101#01000000000000
        3000   > 581#
        3000   < 101#01
        9000   > 281#
        9000   < 101#01
        """,
        connected=False,
    ),
    Transcript(
        "201#C80010270000 starts node 1 asynchronously, 2.00 Hz cut-off, 10 000 µs",
        """
        2033   < 701#
        2500   > 201#C80010270000
        2500   < zeros 0
        2500   < 101#00
        2510   < filtered 77 2.0
        2520   < filtered 155 2.0
        2530   < filtered 233 2.0
        """,
    ),
    Transcript(
        "a cut-off of 0 means unfiltered",
        """
        2033   < 701#
        2500   > 181#0000
        2500   < 101#00
        2500.2 > 080#
        2500.2 < sample 1
        """,
    ),
    Transcript(
        "a payload that is too short counts as 0: unfiltered, and as fast as the bus can",
        """
        2033   < 701#
        2500   > 181#C8
        2500   < 101#00
        2500.2 > 080#
        2500.2 < sample 1
        2501   > 281#
        2501   < 101#00
        2600   > 201#C80010
        2600   < zeros 0
        2600   < 101#00
        2600.26 < filtered 2 2.0
        2600.52 < filtered 4 2.0
        """,
    ),
    Transcript(
        "SYNC sends force then moment, also in asynchronous mode",
        """
        2033   < 701#
        2400   > 080#
        2500   > 201#0000204E0000
        2500   < zeros 0
        2500   < 101#00
        2505   > 080#
        2505   < sample 38
        2520   < sample 155
        2530   > 181#0000
        2530   < 101#00
        2531   > 080#
        2531   < sample 241
        """,
    ),
    Transcript(
        "start-sync ends the asynchronous stream",
        """
        2033   < 701#
        2500   > 201#000010270000
        2500   < zeros 0
        2500   < 101#00
        2510   < sample 77
        2515   > 181#0000
        2515   < 101#00
        9000   > 401#
        9000   < 101#00
        """,
    ),
    Transcript(
        "a running stream takes a new period after the frame that it waits for",
        """
        2033   < 701#
        2500   > 201#000010270000
        2500   < zeros 0
        2500   < 101#00
        2505   > 201#0000204E0000
        2505   < 101#00
        2510   < sample 77
        2530   < sample 233
        """,
    ),
    Transcript(
        "the first asynchronous start since power-up stops what runs: the counter and the offset are lost",
        """
        2033   < 701#
        2500   > 181#0000
        2500   < 101#00
        2510   > 301#
        2510   < 101#00
        2520   > 080#
        2520   < zeros 155
        2530   > 201#000010270000
        2530   < zeros 0
        2530   < 101#00
        2540   < sample 77
        """,
    ),
    Transcript(
        "the frame counter counts full six-axis frames and wraps at 65536",
        """
        2033      < 701#
        2500      > 181#0000
        2500      < 101#00
        10921.3   > 080#
        10921.3   < sample 65535
        10921.4   > 080#
        10921.4   < sample 0
        10921.6   > 080#
        10921.6   < sample 1
        """,
    ),
    Transcript(
        "the frame counter is 0 after stop",
        """
        2033   < 701#
        2500   > 201#000010270000
        2500   < zeros 0
        2500   < 101#00
        2510   < sample 77
        2515   > 281#
        2515   < 101#00
        3000   > 080#
        4000   > 181#0000
        4000   < 101#00
        4000   > 080#
        4000   < zeros 0
        """,
    ),
    Transcript(
        "zero: offset = present filtered value, next output 0; stop/start loses it",
        """
        2033   < 701#
        2500   > 181#0000
        2500   < 101#00
        2510   > 080#
        2510   < sample 77
        2510   > 301#
        2510   < 101#00
        2510.2 > 080#
        2510.2 < zeros 79
        2600   > 281#
        2600   < 101#00
        2700   > 181#0000
        2700   < 101#00
        2710   > 080#
        2710   < sample 77
        """,
    ),
    Transcript(
        "zero while stopped takes the first filtered sample after start",
        """
        2033   < 701#
        2400   > 301#
        2400   < 101#00
        2500   > 181#0000
        2500   < 101#00
        2510   > 080#
        2510   < zeros 77
        """,
    ),
    Transcript(
        "reset stops the stream, re-reads the calibration, acknowledges, sends no boot-up",
        """
        2033   < 701#
        2500   > 201#000010270000
        2500   < zeros 0
        2500   < 101#00
        2505   > 581#
        2510   > 401#
        2520   > 080#
        2538   < 101#00
        2538   < 101#00
        9000   > 401#
        9000   < 101#00
        """,
    ),
    Transcript(
        "unknown ops, other nodes, a SYNC with a node, and frames of other kinds get no answer",
        """
        2033   < 701#
        2500   > 001#
        2500   > 101#00
        2500   > 601#0000000000000000
        2500   > 701#
        2500   > 781#00000000
        2500   > 402#
        2500   > 081#
        2500   > 401#R
        2500   > 00000401#
        9000   > 401#
        9000   < 101#00
        """,
    ),
    Transcript(
        "no watchdog, no heartbeat: a stream without further requests goes on, a gateway at rest is silent",
        """
        2033   < 701#
        30000  > 201#000000093D00
        30000  < zeros 0
        30000  < 101#00
        34000  < sample 31128
        38000  < sample 62256
        42000  < sample 27849
        """,
    ),
    Transcript(
        "what an existing client does: 400; 200; 480 and 500; 0.1 s; 300; on close 280",
        """
        2033   < 701#
        2500   > 401#
        2500   < 101#00
        2500   > 201#0000C0D40100
        2500   < zeros 0
        2500   < 101#00
        2500   > 481#
        2500   < 101#0073006F00B900
        2500   > 501#
        2500   < 101#00380034003D00
        2600   > 301#
        2600   < 101#00
        2620   < zeros 933
        2740   < zeros 1867
        2750   > 281#
        2750   < 101#00
        9000   > 401#
        9000   < 101#00
        """,
    ),
]
"""Transcripts of a gateway without any delay."""

VARIANTS = [
    Transcript(
        "stop joins the stream's thread: the acknowledge comes 22.8 ms later, after the rest of 100 ms",
        """
        2033   < 701#
        2500   > 201#0000A0860100
        2500   < zeros 0
        2500   < 101#00
        2577.2 > 281#
        2590   > 401#
        2600   < 101#00
        2600   < 101#00
        9000   > 401#
        9000   < 101#00
        """,
    ),
    Transcript(
        "stop joins the stream's thread: the acknowledge comes 751 ms later, after the rest of 1 s",
        """
        2033   < 701#
        2500   > 201#000040420F00
        2500   < zeros 0
        2500   < 101#00
        3500   < sample 7782
        3749   > 281#
        4500   < 101#00
        """,
    ),
    Transcript(
        "start-sync joins it too, and the counter goes on meanwhile; a SYNC waits as well",
        """
        2033   < 701#
        2500   > 201#0000A0860100
        2500   < zeros 0
        2500   < 101#00
        2577.2 > 181#0000
        2580   > 080#
        2600   < 101#00
        2600   < sample 778
        """,
    ),
    Transcript(
        "reset joins it too, then reads the calibration",
        """
        2033   < 701#
        2500   > 201#0000A0860100
        2500   < zeros 0
        2500   < 101#00
        2577.2 > 581#
        2633   < 101#00
        9000   > 401#
        9000   < 101#00
        """,
    ),
    Transcript(
        "reset with no sensor: no acknowledge, deaf until a sensor sends",
        """
        2500   > 401#
        2500   < 101#01
        2600   > 581#
        2700   > 401#
        60000  > 281#
        90000  ! plug_in
        90033  < 101#00
        90033  < 101#00
        90033  < 101#00
        90100  > 401#
        90100  < 101#00
        """,
        connected=False,
    ),
    Transcript(
        "unplugged in mid-stream: frames go on with frozen counter and values, stop hangs, deaf for good",
        """
        2033   < 701#
        2500   > 201#0000A0860100
        2500   < zeros 0
        2500   < 101#00
        2600   < sample 778
        2650   ! unplug
        2700   < sample 1167
        2710   > 401#
        2710   < 101#00
        2800   < sample 1167
        2850   > 281#
        3000   > 401#
        99000  > 581#
        """,
    ),
    Transcript(
        "unplugged and plugged in again: the counter goes on where it stood",
        """
        2033   < 701#
        2500   > 201#0000A0860100
        2500   < zeros 0
        2500   < 101#00
        2550   ! unplug
        2600   < sample 389
        2650   ! plug_in
        2700   < sample 778
        """,
    ),
    Transcript(
        "a stop that hangs goes on when the sensor sends again",
        """
        2033   < 701#
        2500   > 201#0000A0860100
        2500   < zeros 0
        2500   < 101#00
        2550   ! unplug
        2560   > 281#
        2570   > 401#
        7000   ! plug_in
        7000   < 101#00
        7000   < 101#00
        """,
    ),
    Transcript(
        "several SYNC within 1 ms are answered once",
        """
        2033   < 701#
        2500   > 181#0000
        2500   < 101#00
        2510.1 > 080#
        2510.4 > 080#
        2510.9 > 080#
        2511   < sample 85
        2513   > 080#
        2513   < sample 101
        """,
    ),
    Transcript(
        "a command waits 0 … 1 ms, for the main loop to wake up",
        """
        2033    < 701#
        2500    > 401#
        2500    < 101#00
        2600.01 > 401#
        2601    < 101#00
        2700.99 > 401#
        2701    < 101#00
        """,
    ),
]
"""Transcripts of the firmware with its delays."""

CLIENT_TRANSCRIPT = """
    2500   > 401#
    2500   < 101#00
    2500   > 201#0000C0D40100
    2500   < zeros 0
    2500   < 101#00
    2500   > 481#
    2500   < 101#0073006F00B900
    2500   > 501#
    2500   < 101#00380034003D00
    2600   > 301#
    2600   < 101#00
    2620   < zeros 933
    2740   < zeros 1867
    2860   < zeros 2801
"""
