"""Robots: one package per kind."""
