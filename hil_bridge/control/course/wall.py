"""Friction and walls: the share of a force against the motion that an obstacle causes. Pure."""


def beyond_friction(against: float, pressed: float, friction_share: float) -> float:
    """Return the part of a force against the motion that friction at the given contact force does not explain, N."""
    return against - friction_share * max(pressed, 0.0)
