# Planner, robot and page in one image, which compose.yaml starts: docs/install.md, "Docker".
FROM ros:jazzy-ros-base

# The dependencies first: a change to the code does not install them again.
WORKDIR /ws
COPY config/package.xml src/config/
COPY msgs/package.xml src/msgs/
COPY mrs_people_loc/package.xml src/mrs_people_loc/
COPY planner_node/package.xml src/planner_node/
COPY robot_node/package.xml src/robot_node/
# hadolint ignore=DL3008
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src --ignore-src --rosdistro jazzy -y \
    && apt-get install -y --no-install-recommends python3-pip \
    && rm -rf /var/lib/apt/lists/*
# For bags; Ubuntu does not package it.
RUN python3 -m pip install --break-system-packages --no-cache-dir rosbags==0.11.9

COPY config src/config
COPY msgs src/msgs
COPY mrs_people_loc src/mrs_people_loc
COPY planner_node src/planner_node
COPY robot_node src/robot_node
RUN . /opt/ros/jazzy/setup.sh \
    && colcon build --merge-install --install-base /opt/mrs --cmake-args -DBUILD_TESTING=OFF \
    && rm -rf build log src

COPY setup/entrypoint.sh /entrypoint.sh
RUN useradd --create-home --uid 1001 mrs
USER 1001
WORKDIR /home/mrs
ENV PATH=/opt/mrs/lib/mrs_people_loc:/opt/mrs/lib/planner_node:/opt/mrs/lib/robot_node:$PATH
# What `ros2 launch` needs to end its nodes in order.
STOPSIGNAL SIGINT
ENTRYPOINT ["/entrypoint.sh"]
CMD ["mrs", "--help"]
