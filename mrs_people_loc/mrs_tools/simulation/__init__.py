"""The simulator behind `mrs simulate`: what the stereo heads of a moving team would see.

    scene.py      the scene file: sections, validated
    layouts.py    random scenes from a few numbers and a seed
    motion.py     where everybody is at a time: standing, turning, paths, walkers, recorded tracks
    meshes.py     triangles with texture coordinates
    textures.py   procedural textures and the atlas they are sampled from
    rooms.py      floor, walls, furniture, clutter
    interiors.py  furniture of lived-in rooms that detectors take for people
    human_body.py articulated people
    robots.py     the robots as solid bodies
    heads.py      cameras: rays of every pixel, and what the sensor makes of the light
    rendering.py  ray casting (Embree) and shading
    odometry.py   what the robots believe about their poses
    stage.py      what a scene looks like, wherever people and robots are
    world.py      all of it together: one frame of one robot
    range_sensors.py  sonars and laser scanners
    range_topics.py   what they measure, as messages
    writer.py     messages, bags, the team's parameter file, live publishing

Without rendering, in a moment:

    tours.py          where a group, its team and the walls are
    light_sensing.py  what the robots see of walls and people
    light_team.py     their localizers, messages between them, and a planner

Live, in real time:

    live_view.py   what the heads see at an instant, fast
    live_world.py  a guided tour on ROS: `cmd_vel` in; odometry, images and the truth out

NumPy, OpenCV and SciPy throughout; only `rendering` needs Embree (`pip install .[sim]`), and
nothing needs ROS but publishing live. Units are metres, seconds and radians; everything is seeded.
"""
