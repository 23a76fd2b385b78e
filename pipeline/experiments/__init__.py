"""The paper's experiments: many simulated runs, judged against the truth, as tables and figures.

presets   the paper's settings and ours
spec      what decides a run, and what is measured of it
measure   one run: simulate, map, compare
batch     many runs in several processes, resumable
summary   mean, median, worst, losses with their interval
report    table.md;  style: figures
and one module an experiment: localmaps particles quality maps readings office table cost
"""
