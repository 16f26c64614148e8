import js from "@eslint/js";
import tseslint from "typescript-eslint";

export default tseslint.config({ ignores: ["src/lab.js"] }, js.configs.recommended, tseslint.configs.strictTypeChecked, {
  languageOptions: { parserOptions: { projectService: true, tsconfigRootDir: import.meta.dirname } },
  rules: {
    // Loops over typed arrays stay within them.
    "@typescript-eslint/no-non-null-assertion": "off",
    // Numbers in messages and keys are whole ones.
    "@typescript-eslint/restrict-template-expressions": ["error", { allowNumber: true }],
  },
});
