"""Wire protocols: conversion between bytes or CAN frames and their meaning, as state machines without I/O.

The package uses only the standard library. No module reads a clock; the caller passes the time.
"""
