"""PI force controller with anti-windup."""
