"""The simulator behind `mrs simulate`: what the stereo heads of a moving team would see.

    scene.py, layouts.py, suite_scenes.py   scene files, validated; random ones, and the suite
    motion.py      where everybody is at a time: standing, turning, paths, walkers, recorded tracks
    models/        what stands there, as triangles: rooms, furniture, people, robots
    walking/       groups that walk, and crowds that follow a guide
    sensors/       stereo heads, odometry and wheels, sonars and laser scanners
    views/         ray casting (Embree), and what the heads see at an instant
    light/         what robots see on tours without rendering; localized, guided, in a moment
    tours.py       where a group, its team and the walls are, without rendering
    guided.py      people on a guided tour, and the robots that guide them
    render_scene.py, writer.py   a scene as a bag: messages, the team's parameter file
    live_world.py  a guided tour on ROS: `cmd_vel` in; odometry, images and the truth out

NumPy, OpenCV and SciPy throughout; only `views.ray_casting` needs Embree (`pip install .[sim]`),
and nothing needs ROS but publishing live. Units are metres, seconds and radians; everything is
seeded.
"""
