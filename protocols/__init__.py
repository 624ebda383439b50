"""Wire formats: bytes to values and back.

What lives here: register maps, the DBC and its protection, line and frame formats, the buffer that splits a byte
stream. What may not: sockets, files, clocks, threads, numpy. Every decoder says how many bytes it used, and tells our
own mistake (`LocalProtocolError`) from the peer's (`RemoteProtocolError`).
"""
