"""A recording's report as a page: verdict first, curves, each alarm with its moment; opens offline, asks nobody.

thinned: curves of bounded length that keep their peaks · curves: what is kept while a recording is judged · moment: a
body in the world, drawn · page: what the page says · templates: what it is made of · files: one page, or an overview
and a page each.
"""
