"""Documents as values: headings, tables, notes and figures, with one writer for each output format.

A section of a report is a function from values to blocks (`rig.document.blocks`) and knows no output format. `html`,
`pdf` and `terminal` write a `Document`. `drawing` lays out every figure as lines and letters, which `svg`, `pdf` and
`png` put on screen, on paper and into pixels; `fonts` has the letters of the last two. Nothing here measures or fits,
and nothing here knows runs or dampers.
"""
