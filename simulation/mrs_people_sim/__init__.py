"""What a workstation has and a robot does not: simulated worlds, the demo, scores, figures.

`scene` describes a room, its people and robots; `render_scene` and `writer` make a bag of it,
`live_world` publishes it while it runs. `light` simulates tours without rendering.
"""
