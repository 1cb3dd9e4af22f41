"""Campaigns: a matrix of configurations, faults and seeds, run in virtual time and judged by criteria.

`plan` reads and checks the file, `working` runs it in processes, `store` keeps the figures, `page` and `comparison`
tell what came of it.
"""
