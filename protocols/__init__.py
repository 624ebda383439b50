"""Wire formats: bytes to values and back.

The room contains Modbus and SCPI, CAN signals and their protection, line and frame formats, and guessing the format of
a stream. Not allowed: sockets, files, clocks, threads, numpy. Every stream decoder takes chunks of any size: a chunk is
never assumed to be a message. Errors of this host (`LocalProtocolError`) are distinguished from errors of the peer
(`RemoteProtocolError`).
"""
