/** Fetches the WebAssembly of Spark while its program loads. */

globalThis.sparkWasm = fetch("spark.wasm").then((response) => response.arrayBuffer());
