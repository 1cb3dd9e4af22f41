"""What holds for every test: how long an example takes on a busy machine says nothing about the code."""

from hypothesis import settings

settings.register_profile("busy machine", deadline=None)
settings.load_profile("busy machine")
