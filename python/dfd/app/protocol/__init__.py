"""The messages between the page and the server on the WebSocket at /ws.

A page that reconnects names its previous session: /ws?session=…. The server first sends `session`, with the name of the
page's session, and then the whole state. The page sends JSON texts, each with a `type` and a number `id` that it
chooses. The server answers each request with one message of the same `id`: `failure`, or `done` unless the request
names another answer. All other messages of the server have the `id` 0. Before it answers a change, the server sends the
`columns` that the page lacks, then `state`. Numbers are finite, lengths are in mesh units, angles in degrees.

A message of the server is a JSON text. With arrays, it is a safetensors file whose metadata has the JSON text as the
entry "message".

A handle has one column of weights W (`columns`), with a value per vertex, or one column for each of its counterparts:

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)      Eq. 1, overlap "add"; `compute` supports all rules

A column without a `frame` has the handle's own transform as D_k. Otherwise, with the handle's linear part L and
translation t, and the column's `frame` F: the linear part of D_k is F L Fᵀ, and D_k maps p to p + F t, where p is
`position` + F (pivot − resting position of the handle). A column is on the side of the plane of symmetry of its
`position`.
"""
