"""Entry point of `python -m hil_bridge`: the command line without an installed script."""

from hil_bridge.cli import main

main()
