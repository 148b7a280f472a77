"""ROS around the method: what `robot_node` and `planner_node` share.

| module | holds |
|---|---|
| `parameters` | configuration as ROS parameters |
| `ending` | when a node is to end: signals, and a parent that is gone |
| `managed_node` | the lifecycle node that starts itself, and `run` |
| `qos` | quality of service of streams and poses |
| `diagnostics` | what arrived, what was dropped and why, on `/diagnostics` |
| `convert` | results as messages (reading messages is `mrs_people_loc.messages`) |
"""
