"""The two experiments of Damsgaard, Adcroft & Sergienko (2018), doi:10.1029/2018MS001299.

`parameters` is the table of all their parameters; `shear` and `strait` run them; `statistics` has the fits;
`figures` draws the paper's figures from the resulting files.
"""
