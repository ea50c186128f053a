"""Comparison of controllers over paired seeded episodes.

`conditions` (environments and departures from their design), `metrics` (measures of episodes), `contenders`
(controllers and their runs), `statistics` (interquartile means and bootstrap intervals), `summary` (statistics of a
comparison), `study` (whole comparisons), `verification` (of stored ones) and `plots`.
"""
