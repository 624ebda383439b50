"""The operator's page: a process of its own that shows a running campaign in browsers, and passes their wishes on.

What lives here: the page (`static`), its server, who may open it, who may command, the ring's samples made ready for
charts. It reads the ring and the live folder without writing to them, and asks by datagrams; so it may stand still, be
killed or be started again at any moment, and the rig does not notice. What may not live here: devices, decisions about
the rig, campaigns, fits, numpy's heavier friends.
"""
