"""ROS bags in and out, without ROS: messages become a recording, a run becomes messages.

bags, unclosed: reading; topics: which is what; images, calibration, frames, wheels, messages:
one kind of message each, both ways; import_plan, import_bag: the one job; export_run, bag_writer:
the other.
"""
