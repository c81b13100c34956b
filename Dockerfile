# A head in a container. Written with care and never built: there was no Docker at hand.
#   docker build --target pip -t head_tracking .     Debian and Python wheels
#   docker build --target jazzy -t head_tracking .   Ubuntu's ROS 2 Jazzy
#   docker run --rm head_tracking --sim
#   docker run --rm --device /dev/ttyUSB0 --network host head_tracking --port /dev/ttyUSB0

FROM python:3.12-slim-bookworm AS pip
COPY . /src
RUN pip install --no-cache-dir '/src[ros,vision,page]'
ENTRYPOINT ["head_tracking"]

FROM ros:jazzy AS jazzy
RUN apt-get update && apt-get install --yes python3-pip python3-opencv opencv-data
COPY . /workspace/src/head_tracking
WORKDIR /workspace
RUN rosdep update --rosdistro jazzy \
    && rosdep install --rosdistro jazzy --from-paths src --ignore-src --default-yes \
    && . /opt/ros/jazzy/setup.sh && colcon build \
    && . install/setup.sh && ros2 run head_tracking head_setup --yes yourdfpy
ENTRYPOINT ["bash", "-c", ". install/setup.bash && exec ros2 run head_tracking head_tracking \"$@\"", "--"]
