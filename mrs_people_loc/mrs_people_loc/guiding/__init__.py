"""Guiding: a tour, the robots' posts around the group, and how robots drive to them.

| module | |
|---|---|
| `tour` | a way with stops; its file |
| `way` | places along a way |
| `free_space` | where robots may drive, and what they see past walls, from the map |
| `guidance` | what flows: posts of robots, state of a tour |
| `views` | who would be seen from where |
| `candidates` | posts that are free, laid out along the way |
| `formation` | posts around the group, chosen by what would be seen from them |
| `guided_group` | who is guided, how far along the way they are, who falls behind |
| `pace` | how fast the leader goes |
| `tour_states` | the table of what the guide finds, and what that makes of a tour |
| `guide` | `Guide`, which owns a tour under way: people and poses in, posts and velocities out |
| `drive` | velocity of a differential drive on its way to a post |
| `steering` | velocities of all robots, from posts, people and poses that come now and then |
| `obstacles` | what laser scanners, sonars and heads see around a robot |
| `collision_monitor` | limits the velocity of a robot by it: what `robot_node` calls |
| `progress` | whether a robot that drives by itself goes to its goal |
| `tour_control` | when a tour may begin and why it ends: what `guide_node` calls |
"""
