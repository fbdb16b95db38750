// Run every case of the module given as the first argument: `row <case>|<scalar>|<digest>` each.
import { readFileSync } from "node:fs";

const module = new WebAssembly.Module(readFileSync(process.argv[2]));
const imports = WebAssembly.Module.imports(module);
if (imports.length > 0) {
  console.error("the module has imports:", imports);
  process.exit(1);
}
const { run, digest, bits, name, name_length, memory } = new WebAssembly.Instance(module).exports;
for (let i = 0; run(i) === 1; i += 1) {
  const text = new TextDecoder().decode(new Uint8Array(memory.buffer, name(), name_length()));
  const hash = BigInt.asUintN(64, digest()).toString(16).padStart(16, "0");
  console.log(`row ${text}|f${bits()}|${hash}`);
}
