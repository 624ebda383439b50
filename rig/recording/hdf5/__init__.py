"""A point's file as HDF5: written as an image, checked before anything in it is believed, read into plain values.

Everything that knows h5py lives here, in `conversion.finishing` (proof by reading back) and in
`conversion.delay_correction` (verdicts written again).
"""
