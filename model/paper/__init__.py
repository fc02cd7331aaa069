"""Paper mode: the network's own output, validated as the paper does (section 5), nothing refined.

Knows `model.geometry` and the proposals of `model.network`; never the search of full mode.
"""
