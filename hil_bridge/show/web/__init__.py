"""A run, a recording or a campaign in the browser, and live in Foxglove. Needs the extra `web`.

A run only feeds a process of its own (`feed`), which serves the page (`serving`). So no browser can disturb the loop.
"""
