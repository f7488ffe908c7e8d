// The client of the official TypeScript SDK: a program that calls tools by itself; what to call it asks the plain story.

import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";

const task = JSON.parse(readFileSync(process.argv[2], "utf8"));
const require = createRequire(task.packages);
const { Client, StreamableHTTPClientTransport } = require("@modelcontextprotocol/client");
const { StdioClientTransport } = require("@modelcontextprotocol/client/stdio");

async function nextMove(tools, shown) {
  const asked = { method: "POST", body: JSON.stringify({ tools, shown }) };
  return (await fetch(`${task.model}/story`, asked)).json();
}

const transport = task.url
  ? new StreamableHTTPClientTransport(new URL(task.url))
  : new StdioClientTransport({ command: task.command, args: task.arguments, env: { ...process.env, ...task.env } });
const client = new Client({ name: "story-in-typescript", version: "1.0.0" }, { versionNegotiation: { mode: "auto" } });
await client.connect(transport);
const tools = (await client.listTools()).tools.map((tool) => tool.name);
const shown = [];
let notes = 0;
let move = await nextMove(tools, shown);
while (move.tool) {
  const options = { timeout: 120_000, onprogress: () => { notes += 1; } };
  const result = await client.callTool({ name: move.tool, arguments: move.arguments }, options);
  const structured = result.structuredContent ? [result.structuredContent] : [];
  shown.push({ tool: move.tool, content: [...result.content, ...structured] });
  move = await nextMove(tools, shown);
}
await client.close();
writeFileSync(task.report, JSON.stringify({ said: move.text, progress: notes }));
