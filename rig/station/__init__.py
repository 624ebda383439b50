"""The I/O process: owns every port, checks every sample, stops the rig.

The room contains the station's threads, interlocks, safe stop, the link to the application and the application's end of
that link (`client`). Not allowed: numpy, pandas, h5py, pydantic, test matrices, bench files. It knows only its own
`StationConfig`, and it stops the rig safely if the application ends.
"""
