"""`python -m hil_bridge`: the command line where no script is installed."""

from hil_bridge.cli import main

main()
