"""The I/O process: owns every port, judges every sample, stops the rig.

What lives here: the station's threads, interlocks, safe stop, the link to the application and the application's end of
that link (`client`). What may not: numpy, pandas, h5py, pydantic, test matrices, bench files. It knows only its own
`StationConfig`, and it goes on stopping the rig safely when the application is gone.
"""
