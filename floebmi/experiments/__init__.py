"""The two experiments of Damsgaard, Adcroft & Sergienko (2018), doi:10.1029/2018MS001299.

`parameters` is the one table of all their numbers; `shear` and `strait` run them; `statistics` fits;
`figures` draws the paper's figures from the files that they leave.
"""
