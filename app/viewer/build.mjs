// Builds ../static/viewer: one script, one worker, one style sheet, the page that names them, the examples.
// Names carry a hash of the content, so that a browser may keep what it has and never shows an old viewer.
// `--out=FOLDER` builds elsewhere; `--tests` bundles the unit tests into node_modules/.tests instead.
import { build } from "esbuild";
import { cp, mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { basename, join } from "node:path";

const OUT = process.argv.find((word) => word.startsWith("--out="))?.slice(6) ?? "../static/viewer";
const COMMON = { bundle: true, format: "esm", target: "es2022", charset: "utf8", logLevel: "warning" };

/** Builds one entry point under a hashed name, and answers that name. */
async function asset(entry, options = {}) {
  const result = await build({
    ...COMMON,
    entryPoints: [entry],
    entryNames: "[name]-[hash]",
    outdir: OUT,
    minify: true,
    legalComments: "eof",
    metafile: true,
    ...options,
  });
  return basename(Object.keys(result.metafile.outputs).find((name) => !name.endsWith(".map")));
}

async function site() {
  await rm(OUT, { recursive: true, force: true });
  await mkdir(OUT, { recursive: true });
  const worker = await asset("src/worker.ts", { entryNames: "worker-[hash]" });
  const script = await asset("src/main.ts", {
    entryNames: "viewer-[hash]",
    define: { WORKER_FILE: JSON.stringify(worker) },
  });
  const style = await asset("src/style.css", { entryNames: "viewer-[hash]" });
  const page = await readFile("src/index.html", "utf8");
  await writeFile(join(OUT, "index.html"), page.replace("SCRIPT", script).replace("STYLE", style));
  await cp("src/icon.svg", join(OUT, "icon.svg"));
  await cp("examples", join(OUT, "examples"), { recursive: true });
  await cp("node_modules/three/LICENSE", join(OUT, "three-LICENSE.txt"));
}

async function tests() {
  const files = (await readdir("test")).filter((name) => name.endsWith(".test.ts"));
  await rm("node_modules/.tests", { recursive: true, force: true });
  await build({
    ...COMMON,
    entryPoints: files.map((name) => join("test", name)),
    outdir: "node_modules/.tests",
    outExtension: { ".js": ".mjs" },
    platform: "node",
  });
}

await (process.argv.includes("--tests") ? tests() : site());
