"""Campaigns: a matrix of configurations, faults and seeds, run in virtual time and judged by criteria.

`plan_file` reads and checks the plan, `working` executes it in processes, `store` keeps the figures, and `page` and
`comparison` present the results.
"""
