"""Started by `feed.Feed`."""

import sys

from hil_bridge.show.web.serving import main

main(sys.argv[1:])
