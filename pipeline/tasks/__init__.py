"""Many tasks at once: in processes of this machine, or on the workers of a Dask cluster.

task        a task as the process that does it sees it
runner      who does the tasks: opened once, then given tasks
processes   local processes;  cluster: Dask;  identity: is a worker's beemap the same as ours?
folder      a folder of results that is gone on with
"""
