"""How near `dfd.Geodesics` comes to exact distances, and how fast, beside a heat solve on the full mesh."""
