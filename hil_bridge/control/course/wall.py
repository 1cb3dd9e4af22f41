"""Friction and walls: which part of a force against the way something in the way makes. Pure."""


def beyond_friction(against: float, pressed: float, friction_share: float) -> float:
    """Part of a force against the way, N, that friction at this contact force, N, does not explain."""
    return against - friction_share * max(pressed, 0.0)
