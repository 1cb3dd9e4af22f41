"""Started by `feed.Feed`."""

import sys

from hil_bridge.web.serving import main

main(sys.argv[1:])
