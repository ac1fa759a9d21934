// The Foxglove websocket, read by Foxglove's own client.

import assert from "node:assert/strict";
import { test } from "node:test";
import protocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";
import { Served } from "./served.mjs";

const { FoxgloveClient } = protocol;
const { TRINOCULAR } = process.env;
const TOPICS = ["/camera/left", "/camera/middle", "/camera/right", "/measurement", "/stage",
  "/station", "/target"];

// Waits for one message of every topic.
function messages(url) {
  return new Promise((resolve, reject) => {
    const found = new Map();
    const topics = new Map();
    // The server speaks the protocol's later name; the messages are the same.
    const client = new FoxgloveClient({ ws: new WebSocket(url, ["foxglove.sdk.v1"]) });
    client.on("error", reject);
    client.on("advertise", (channels) => {
      for (const channel of channels) topics.set(client.subscribe(channel.id), channel);
    });
    client.on("message", ({ subscriptionId, data }) => {
      const channel = topics.get(subscriptionId);
      const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
      found.set(channel.topic, { channel, bytes });
      if (found.size === TOPICS.length) {
        client.close();
        resolve(found);
      }
    });
  });
}

test("client reads images, poses and measurements", async (t) => {
  const served = new Served(TRINOCULAR, "--foxglove=127.0.0.1:0");
  t.after(() => served.close());
  const found = await messages(await served.line(/Foxglove websocket: (\S+)/g));
  assert.deepEqual([...found.keys()].sort(), TOPICS);
  const json = (topic) => JSON.parse(new TextDecoder().decode(found.get(topic).bytes));
  const measurement = json("/measurement");
  assert.ok(measurement.points > 10, JSON.stringify(measurement));
  assert.equal(typeof measurement.displacement_mm.x, "number");
  assert.equal(json("/station").station.state, "following");
  assert.equal(found.get("/camera/left").channel.schemaName, "foxglove.CompressedImage");
  assert.equal(found.get("/stage").channel.schemaName, "foxglove.PoseInFrame");
  // A JPEG is inside.
  const image = Buffer.from(found.get("/camera/left").bytes);
  assert.ok(image.includes(Buffer.from([0xff, 0xd8, 0xff])), "start of a JPEG");
});
