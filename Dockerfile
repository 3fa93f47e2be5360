# docker build -t lumel . && docker run --rm -v "$PWD:/level" lumel bake /level/level.glb -o /level/out
FROM rust:1.95-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++ && rm -rf /var/lib/apt/lists/*
COPY . /lumel
WORKDIR /lumel
RUN cargo build --release --locked -p lumel

FROM debian:bookworm-slim
# xatlas and meshoptimizer are C++.
RUN apt-get update && apt-get install -y --no-install-recommends libstdc++6 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /lumel/target/release/lumel /usr/local/bin/lumel
ENTRYPOINT ["lumel"]
