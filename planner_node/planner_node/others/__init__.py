"""The people in messages that other packages understand (docs/use_with.md).

| module | |
|---|---|
| `publishing` | `Others`: the publishers, which of them there are, and when they publish |
| `social` | people_msgs/People |
| `hri` | hri_msgs, as REP 155 has it |
| `detections` | vision_msgs/Detection3DArray |
| `frames` | a TF frame for each person |
| `costmap` | nav_msgs/OccupancyGrid for Nav2 |

Conversions take the package's module of messages (`people_msgs.msg`), so that nothing here needs a
package that is not installed.
"""
