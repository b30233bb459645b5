/** A static server for the browser tests. */

import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import type { AddressInfo } from "node:net";
import { extname, join, normalize } from "node:path";

const TYPES: Record<string, string> = {
  ".html": "text/html",
  ".js": "text/javascript",
  ".css": "text/css",
  ".wasm": "application/wasm",
};

export interface StaticServer {
  url: string;
  close(): void;
}

/** Serve folders by the first part of the path: `{ page: "build/page" }` serves build/page/x as /page/x. */
export async function serve(folders: Record<string, string>): Promise<StaticServer> {
  const server = createServer(async (request, response) => {
    const [, first, ...rest] = normalize(new URL(request.url ?? "/", "http://x").pathname).split("/");
    try {
      if (!(first in folders)) throw new Error("unknown folder");
      const path = join(folders[first], rest.join("/") || "index.html");
      const content = await readFile(path);
      response.writeHead(200, { "Content-Type": TYPES[extname(path)] ?? "application/octet-stream" }).end(content);
    } catch {
      response.writeHead(404).end();
    }
  });
  await new Promise<void>((resolve) => server.listen(0, "127.0.0.1", resolve));
  return {
    url: `http://127.0.0.1:${(server.address() as AddressInfo).port}`,
    close: () => {
      server.closeAllConnections();
      server.close();
    },
  };
}
