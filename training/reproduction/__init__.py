"""The paper's tables and figures on data at hand, one command each: experiments as TOML, results as files.

Knows all of training; nothing knows it but the command line. An experiment is one file in `experiments`.
"""
