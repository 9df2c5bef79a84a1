// Reads a recording with the packages that Foxglove uses for MCAP files, and prints the content.
// node foxglove.js FOLDER_OF_PACKAGES FILE
const { createRequire } = require("node:module");
const fs = require("node:fs");

const from = createRequire(process.argv[2] + "/");
const { McapIndexedReader } = from("@mcap/core");
const { loadDecompressHandlers } = from("@mcap/support");
const { FileHandleReadable } = from("@mcap/nodejs");
const { parse } = from("@foxglove/rosmsg");
const { MessageReader } = from("@foxglove/rosmsg2-serialization");

async function main() {
  const reader = await McapIndexedReader.Initialize({
    readable: new FileHandleReadable(await fs.promises.open(process.argv[3])),
    decompressHandlers: await loadDecompressHandlers(),
  });
  const readers = new Map();
  const topics = {};
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    readers.set(channel.id, new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true })));
    topics[channel.topic] = { schema: schema.name, encodings: [schema.encoding, channel.messageEncoding], count: 0 };
  }
  const positions = [];
  for await (const message of reader.readMessages()) {
    const topic = topics[reader.channelsById.get(message.channelId).topic];
    const value = readers.get(message.channelId).readMessage(message.data);
    topic.count += 1;
    if (topic.schema === "sensor_msgs/msg/JointState") positions.push(Array.from(value.position));
    if (topic.schema === "sensor_msgs/msg/PointCloud2") {
      topic.cloud = { frame: value.header.frame_id, fields: value.fields, step: value.point_step, width: value.width };
    }
  }
  const metadata = {};
  for await (const record of reader.readMetadata()) metadata[record.name] = Object.fromEntries(record.metadata);
  console.log(JSON.stringify({ profile: reader.header.profile, topics, positions, metadata }));
}

main();
