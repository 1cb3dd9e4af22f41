"""Campaigns: a matrix of configurations, faults and seeds, run in virtual time and judged by criteria.

`plan_file` reads and checks the plan, `working` runs it in processes, `store` keeps the figures, `page` and
`comparison` present the results.
"""
