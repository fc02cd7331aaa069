"""Many meshes on many cores and machines: ``prsnet bulk``, with the extra ``bulk`` (Ray Data and pyarrow).

``locations`` lists what there is in folders, patterns, tar shards and object stores, ``columns`` says how an answer is
a row of a table, ``results`` knows what the output holds already, ``plan`` cuts what is missing into pieces, ``job``
lets Ray Data hand them to actors, each of which (``detecting``) works with the service's own hardened worker processes,
and ``summary`` tells how it went.
"""
