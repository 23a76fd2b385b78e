"""Mapping: scans and motion -> local maps (stage 1) -> particle filter (stage 2) -> map and path.

from mapping.mapper import HierarchicalMapper

mapper = HierarchicalMapper()
for scan, motion in data:
    pose = mapper.add(scan, motion)
grid, path = mapper.finish()
"""
