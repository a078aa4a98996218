"""What the page and the server say to each other over the WebSocket at /ws.

The page connects with its session of before, if it has one: /ws?session=…. It is greeted by `session`, which says
which one it has got, and by all that there is. It sends JSON texts, each with a `type` and a number `id` of its own
choosing. The server answers every one that succeeds by one message with the same `id` (`done` unless another is named
below) and one that does not by `failure`. What it sends unasked has the `id` 0: before the answer to any change the
`columns` that the page has not got, then `state`. Numbers are finite, lengths are in mesh units, angles in degrees.

A message of the server is a JSON text or, where it carries arrays, a file of safetensors. There the JSON text is the
entry "message" of the metadata.

A handle has a column of weights W, a value per vertex (`columns`), or one for each of its counterparts:

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)      Eq. 1 in its adding form; `compute` poses by any

With the handle's linear part L and translation t, and the column's `frame` F, the linear part of D_k is F L Fᵀ, and D_k
maps p to p + F t, where p is `position` + F (pivot − where the handle rests); without a frame, D_k is the handle's own
transform. A column is on the side of a plane of symmetry on which its `position` is.
"""
