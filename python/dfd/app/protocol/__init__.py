"""The messages between the page and the server on the WebSocket at /ws.

The server first sends `session`, which contains the session's name, and then the whole state. To reconnect, a page
opens /ws?session=NAME. Requests of the page are JSON texts with a `type` and an `id`, a number that the page chooses.
The server answers a request with one message of the same `id`: `failure` if the request fails, else the answer that
the request documents, else `done`. All other messages of the server have the `id` 0. Before the answer to a change of
the edit, the server sends new weights (`columns`), if any, then `state`. Lengths are in mesh units, angles in degrees.

A message of the server is a JSON text. A message with arrays is a safetensors file instead: the entry "message" of its
metadata is the JSON text.

A column of weights W_k has one value for each vertex. A handle has one column, or one column for each counterpart if
counterparts have their own pivots. With linear blends and the preset "default", Eq. 1 moves resting points V to V':

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)

D₀ is `default` in `state`. D_k is the handle's transform, mapped to the counterpart by the column's `frame` F. If the
handle's transform has the linear part L and the translation t, D_k has the linear part F L Fᵀ, and moves the point
p = `position` + F (pivot − position of the handle) to p + F t. With a plane of symmetry, D_k moves the side on which
the column's `position` lies, and the mirror image of D_k moves the other side.
"""
