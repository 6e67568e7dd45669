"""Studies of many cases: a plan of dispersed parameters, run on one machine or a cluster, and what it says.

``ps-fmu sweep STUDY.toml``; docs/studies.md says how a study is written.
"""
