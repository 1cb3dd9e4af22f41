"""Entry point of the process that `feed.Feed` starts."""

import sys

from hil_bridge.show.web.serving import main

main(sys.argv[1:])
