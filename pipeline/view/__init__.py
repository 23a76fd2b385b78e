"""`beemap view`: a run on one time line in rerun's viewer.

scene: what is where; entities: one kind of thing each; replay: a run made again and shown as it
goes; server: the viewer on 127.0.0.1.
"""
