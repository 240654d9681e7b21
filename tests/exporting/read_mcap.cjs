// Reads an MCAP file as Foxglove does, with its own packages, and prints as JSON what it found. Without a file nothing:
// that the packages are there.
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { loadDecompressHandlers } = require("@mcap/support");
const published = require("@foxglove/schemas/jsonschema");
const { open, readFile } = require("node:fs/promises");

(async () => {
  const path = process.argv[2];
  if (!path) return;
  const decompressHandlers = await loadDecompressHandlers();

  // From its first byte to its last: throws where a record is malformed or a checksum does not hold.
  const stream = new McapStreamReader({ validateCrcs: true, decompressHandlers });
  stream.append(await readFile(path));
  let streamed = 0;
  for (let record; (record = stream.nextRecord()) !== undefined; ) streamed += record.type === "Message";

  // By its index, as a player does: in order of time.
  const file = await open(path);
  const indexed = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(file), decompressHandlers });
  const messages = [];
  for await (const { channelId, logTime, data } of indexed.readMessages()) {
    const { topic, schemaId } = indexed.channelsById.get(channelId);
    const said = JSON.parse(Buffer.from(data).toString());
    messages.push({ topic, schema: indexed.schemasById.get(schemaId).name, t_ns: logTime.toString(), said });
  }
  await file.close();
  const whole = stream.done() && stream.bytesRemaining() === 0;
  const schemas = { "foxglove.FrameTransform": published.FrameTransform, "foxglove.Log": published.Log };
  process.stdout.write(JSON.stringify({ whole, streamed, messages, schemas }));
})();
