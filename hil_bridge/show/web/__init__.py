"""Live view of a run, a recording or a campaign in the browser and in Foxglove. Requires the extra `web`.

A separate process serves the page (`serving`). The run only sends data to it (`feed`), so no browser can disturb
the control loop.
"""
