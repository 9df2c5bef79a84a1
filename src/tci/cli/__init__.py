"""`tci` on the command line. One module per command; `main` gathers them."""
