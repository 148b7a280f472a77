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
| `guide` | `Guide.step`: people and poses in, posts and pace out |
| `drive` | velocity of a differential drive on its way to a post |
| `steering` | velocities of all robots, from posts, people and poses that come now and then |
| `running_tour` | `RunningTour`: guide and steering of a tour under way; what `guide_node` calls |
"""
