"""A fitted model as source code of other languages, translated from its kernel: no formula is written twice.

`program` joins a kernel and its integration to functions of one sample; `functions` reads them as syntax trees;
`c_source`, `octave_source` and `python_source` print those.
"""
