"""What the page and the server say to each other over the WebSocket at /ws.

The page sends JSON texts, each with a `type` and a number `id` of its own choosing. The server answers every one that
succeeds by one message with the same `id` (`done` unless another is named below) and one that does not by `failure`.
What it sends unasked has the `id` 0: before the answer to any change the `columns` that the page has not got, then
`state`. Numbers are finite, lengths are in mesh units, angles in degrees.

A message of the server is a JSON text, or binary where it carries arrays:

    bytes 0 … 3      N, the length of the header, unsigned, little-endian
    bytes 4 … 4+N    the header, JSON in UTF-8, padded with spaces so that 4 + N is a multiple of 8
    then             the buffers one after the other, each padded with zeros to a multiple of 8, little-endian

`buffers` of the header describes each with its name, type, shape and offset in bytes from the end of the header.

Distances travel, not weights. Of each handle the page has one column of numbers, a value per vertex (`columns`), and of
the edit what it makes of them (`state`), so that reach, falloff and locality act without a new bind:

    kind "distance"   W = f(max(1 − d / reach, 0)), with `falloff` f              Eq. 4 and 5
                      W = max(W − F, 0), F the number in the column of fixed places     Eq. 6
                      W = W (1 − G)^exponent, G in the column's `geodesic`      Eq. 7
                      W = strength · min(gain · W, 1)
    kind "weight"     W is the number itself
    falloff of x      linear x, smooth x² (3 − 2 x), sharp x², root √x, sphere √(x (2 − x)), constant 1 where x > 0

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)      Eq. 1 in its adding form; `compute` poses by any

A column with counterparts acts through them instead: W_k D_k is the sum of min(gain · share · W_k, 1) times the
transform M of the counterpart. With the handle's linear part L and translation t, and the counterpart's `frame` F, the
linear part of M is F L Fᵀ, and M maps p to p + F t, where p is `position` + F (pivot − where the handle rests). A
counterpart is on the side of a plane of symmetry on which its `position` is.
"""
