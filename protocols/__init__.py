"""Wire formats: bytes to values and back.

What lives here: Modbus and SCPI, CAN signals and their protection, line and frame formats, and how a stream's format is
guessed. What may not: sockets, files, clocks, threads, numpy. Every decoder says how many bytes it used, and tells
our own mistake (`LocalProtocolError`) from the peer's (`RemoteProtocolError`).
"""
