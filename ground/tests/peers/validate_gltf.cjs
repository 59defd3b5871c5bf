// Khronos' validator on a GLB file: prints its report, and fails if there is an error or a warning.
const fs = require("fs");
const validator = require("gltf-validator");

validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), { maxIssues: 20 }).then((report) => {
  console.log(JSON.stringify(report, null, 1));
  process.exit(report.issues.numErrors + report.issues.numWarnings > 0 ? 1 : 0);
});
