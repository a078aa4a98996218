"""The messages between the page and the server on the WebSocket at /ws.

The server first sends `session`, which contains the session's name, and then the whole state. To reconnect, a page
opens /ws?session=NAME. Requests of the page are JSON texts with a `type` and an `id`, a number that the page chooses.
The server answers a request with one message of the same `id`. If the request fails, the answer is `failure`.
Otherwise, it is the message that the request's description names, or `done` if the description names none. All other
messages have the `id` 0. Before the server answers a request that changes the edit, it sends new weights as `columns`,
then `state`. Lengths are in mesh units, angles in degrees.

A message of the server without arrays is a JSON text. A message with arrays is a safetensors file, and the entry
"message" in the metadata of this file is the JSON text.

A column of weights W_k has one value for each vertex. A handle has one column, or one for each counterpart if
these have their own pivots. With the preset "default", small rotations and no bends, Eq. 1 moves a point V to V':

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)

D₀ is `default` in `state`. The column's `frame` F maps the handle's transform to the transform D_k of the counterpart.
If the handle's transform has the linear part L and the translation t, D_k has the linear part F L Fᵀ. D_k moves the
point p = column's `position` + F (handle's `pivot` − handle's `position`) to p + F t. With a plane of symmetry, D_k
moves the side on which the column's `position` lies, and the mirror image of D_k moves the other side.
"""
