"""ROS around the method: what `robot_node` and `planner_node` share.

| module | holds |
|---|---|
| `managed_node` | the base of the nodes: parameters, inputs, diagnostics, life cycle |
| `parameters` | configuration as ROS parameters |
| `qos` | quality of service of streams and poses |
| `diagnostics` | inputs that count what is dropped and why; `/diagnostics` |
| `convert`, `markers` | results as messages (reading messages is `mrs_people_loc.messages`) |
| `tf` | frames, published and looked up |
| `running` | the process of a node, from its arguments to its exit code |
| `ending` | when that process is to end: signals, and the end of its parent |
| `network` | the ROS domain, and the Fast DDS profile |
| `discovery` | how nodes find each other without multicast |
| `security` | SROS 2 |
| `processes` | the processes of a team, as `mrs up` starts them |
| `launch_files` | what the launch files share |
"""
