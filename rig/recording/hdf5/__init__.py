"""A point's file as HDF5: written as an image, checked before its content is trusted, read into plain values.

All code that uses h5py is here, in `conversion.finishing` (verification by reading back) and in
`conversion.delay_correction` (rewritten verdicts).
"""
