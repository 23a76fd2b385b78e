"""Many recordings mapped by one command: `beemap batch`.

inputs      which recordings are meant, and under which names their results go
map_task    one of them, as a worker does it
run         all of them, resumable
rows        what came out, read from the result folders
page        table.md, table.csv and index.html
"""
