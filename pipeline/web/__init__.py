"""Pages in a browser beside a running command; needs the extra `web`.

The core knows nothing of what a page shows:

    messages.py     a topic's newest state as bytes
    hub.py          viewers; each gets the newest of every topic, at its own pace
    connections.py  bounds on what may be connected
    access.py       who may look: token, Host, Origin
    app.py          the few addresses there are
    encoding.py     images and arrays as few bytes
    server.py       a thread with all of this, on a free port

To add a page, write an HTML file into `static/` that loads `page.css` and a module of its own,
which calls `watch({topic: (values, blob) => ...}, onLine)` of `connection.js`; and a class with the
members of `hub.Page`:

    class Clock:
        index = "clock.html"

        def news(self):
            yield Message("time", {"seconds": time.time()})   # at most five times a second, and
                                                              # only while somebody looks
        def command(self, name, value):
            raise RefusedError(f"a clock cannot {name}")
        def report(self):
            return None

    with WebServer(Clock(), host=None, port=None, tell=print) as server:
        print(server.url)
        ...

They are called in the server's thread: what other threads hand over are references, put into
attributes. `pipeline/commands/web_options.py` has the options of the command line.
"""
