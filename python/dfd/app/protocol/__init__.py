"""The messages between the page and the server on the WebSocket at /ws.

The server first sends `session`, which contains the session's name, and then the whole state. A page that reconnects
gives this name: /ws?session=…. The page sends requests as JSON texts. Each has a `type`, and an `id`, a number that the
page chooses. The server answers a request with one message of the same `id`: `failure`, the answer that the request
documents, or else `done`. All other messages of the server have the `id` 0. Before the server answers a change of the
edit, it sends the `columns` that the page lacks, then `state`. Lengths are in mesh units and angles in degrees.

A message of the server is a JSON text. If it has arrays, it is a safetensors file, with the JSON text as the entry
"message" of the metadata.

A column of weights W_k has one value for each vertex. A handle has one column, or one for each of its counterparts if
they have their own pivots. With the preset "default", Eq. 1 moves the resting positions V to V':

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)

D₀ is `default` in `state`. D_k is the handle's transform, mapped to the counterpart by the column's `frame` F. With the
handle's linear part L and translation t, D_k has the linear part F L Fᵀ, and maps the point p = `position` +
F (pivot − position of the handle) to p + F t. A column acts on the side of the plane of symmetry on which its
`position` lies, and its mirror image on the other side.
"""
