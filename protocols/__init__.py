"""Wire formats: bytes to values and back.

What lives here: Modbus and SCPI, CAN signals and their protection, line and frame formats, and how a stream's format is
guessed. What may not: sockets, files, clocks, threads, numpy. Every decoder of a stream takes chunks of any size: a
chunk is never taken for a message. Our own mistake (`LocalProtocolError`) is told from the peer's
(`RemoteProtocolError`).
"""
