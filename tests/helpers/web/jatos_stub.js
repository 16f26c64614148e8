// A stand-in for jatos.js 3.10: what our page uses of it, with its behaviour at the edges. The server
// of the tests keeps the data. Appended strings are joined without a separator; a request that is not
// answered in 30 s is sent again, five times, though it may have arrived; a page that is loaded again
// has a new component result. A patch of the batch session counts only if nobody patched in between.
// The page's address is without the parameters of the link, which JATOS keeps. Two of its parts are
// scripts that jQuery's getScript puts into the page as text.
window.jatos = (() => {
  const part = document.createElement("script");
  part.text = "window.jatosParts = true;";
  document.head.append(part);
  if (!window.jatosParts) throw new Error("jatos.js needs inline scripts while it begins");
  const link = Object.fromEntries(new URLSearchParams(location.search));
  history.replaceState(null, "", location.pathname);
  const state = STATE;
  const once = (what, body) => new Promise((resolve, reject) => {
    const late = setTimeout(() => reject(new TypeError("timeout")), 30_000);
    fetch(`/jatos/${what}`, { method: "POST", body: JSON.stringify(body) })
      .then((answer) => (answer.ok ? answer.json() : Promise.reject(new Error(`${answer.status}`))))
      .then(resolve, reject)
      .finally(() => clearTimeout(late));
  });
  const ask = async (what, body) => {
    for (let left = 5; ; left--) {
      try {
        return await once(what, body);
      } catch (error) {
        if (!(error instanceof TypeError) || left <= 0) throw error;
        await new Promise((resolve) => setTimeout(resolve, 1000));
      }
    }
  };
  const patch = async (op, path, value) => {
    const told = await ask("batch", { op, path, value, version: state.version });
    Object.assign(state, { batch: told.batch, version: told.version });
    if (!told.done) throw new Error("409");
  };
  let count = 0;
  const jatos = {
    version: "3.10.4",
    studySessionData: state.session,
    studyResultUuid: "a-study-run",
    urlQueryParameters: link,
    onLoad: (call) => { if (document.readyState === "complete") call(); else addEventListener("load", call); },
    appendResultData: async (data) => {
      await ask("append", { data, component: state.component });
      if (++count % 7 === 0) await ask("append", { data, component: state.component });
    },
    setStudySessionData: async (data) => { await ask("session", data); jatos.studySessionData = data; },
    endStudy: async (done, message) => { await ask("end", { done, message }); document.title = "ended"; },
    endStudyAndRedirect: async (url, done) => { await ask("end", { done, url }); document.title = "ended"; },
    uploadResultFile: async (data, name) => { await ask("file", { data, name: `${state.component}/${name}` }); },
    abortStudy: async (message) => { await ask("abort", { message }); document.title = "aborted"; },
    batchSession: {
      get: (name) => state.batch[name],
      defined: (path) => path.slice(1) in state.batch,
      add: (path, value) => patch("add", path, value),
      replace: (path, value) => patch("replace", path, value),
      test: (path, value) => patch("test", path, value),
    },
  };
  return jatos;
})();
