# MERLIN in a container: what make deb makes, on Debian 12. docs/platforms.md
#   docker build --target robot -t merlin:robot .
#   docker build --target simulation -t merlin:simulation .
ARG BASE=debian:12-slim

FROM ${BASE} AS source
RUN apt-get update && apt-get install -y --no-install-recommends make ca-certificates
COPY . /merlin
WORKDIR /merlin

FROM source AS robot-package
RUN make -s deb PROFILE=robot

FROM source AS simulation-package
RUN make -s deb PROFILE=simulation

FROM ${BASE} AS user
# What Debian's SciPy and catkin were made with, and need no more; with them come a compiler, a linker, make and CMake.
RUN mkdir -p /tmp/stub/DEBIAN && printf '%s\n' 'Package: merlin-no-compiler' 'Version: 1' 'Architecture: all' \
  'Maintainer: MERLIN' 'Provides: python3-pythran, cmake-extras' \
  'Description: stands for what nothing in this image is compiled with' >/tmp/stub/DEBIAN/control && \
  dpkg-deb --build /tmp/stub /tmp/stub.deb && dpkg -i /tmp/stub.deb && rm -r /tmp/stub /tmp/stub.deb
RUN useradd --create-home --uid 1000 --groups audio --shell /bin/bash merlin
# The script of the workspace would take the words of the command for its own.
ENTRYPOINT ["/bin/bash", "-c", "words=(\"$@\"); set --; . /opt/merlin/setup.bash; exec \"${words[@]}\"", "merlin"]
CMD ["rosrun", "merlin", "doctor"]
STOPSIGNAL SIGINT
WORKDIR /home/merlin

FROM user AS simulation
RUN --mount=type=bind,from=simulation-package,source=/merlin/results/deb,target=/deb \
  apt-get update && apt-get install -y --no-install-recommends /deb/*.deb && apt-get clean && rm -rf /var/lib/apt/lists/*
USER merlin

FROM user AS robot
RUN --mount=type=bind,from=robot-package,source=/merlin/results/deb,target=/deb \
  apt-get update && apt-get install -y --no-install-recommends alsa-utils /deb/*.deb && apt-get clean && rm -rf /var/lib/apt/lists/*
USER merlin
