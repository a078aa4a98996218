"""How fast the app is: from mesh to page, from click to heat map, what a drag costs, how many tabs there can be."""
