"""Pages of a session: their texts filled in, their keys, and the question before quitting."""

from __future__ import annotations

from protocols.study_file.participant_texts import fill
from protocols.study_file.session_schema import ClosingQuestion, Response, Texts
from study_app.stage import Page, PageResult, Stage


class Dialogue:
    """Shows a participant's pages on a stage.

    Parameters
    ----------
    stage : Stage
        Open.
    response : Response
        Whose keys turn pages and quit.
    texts : Texts
        In the participant's language.
    blocks : int
        How many there are in all.
    """

    def __init__(self, stage: Stage, response: Response, texts: Texts, blocks: int) -> None:
        self._stage, self._response = stage, response
        self._texts, self._blocks = texts, blocks
        self.keys = (*response.continue_keys, *response.quit_keys)

    def show(
        self, name: str, text: str, *, least_s: float = 0.0, wait: bool = True, done: int = 0
    ) -> PageResult:
        """Show a page; after the quit key ask, and show it again if the session goes on."""
        keys = self.keys if wait else ()
        share = done / self._blocks if done else 0.0
        page = Page(name, self.filled(text, done), keys, least_s=least_s, done_share=share)
        result = self._stage.page(page)
        while name != "paused" and self.quit_pressed(result):
            asked = self.ask_to_quit()
            if self.quit_pressed(asked):
                return asked
            result = self._stage.page(page)
        return result

    def ask(self, question: ClosingQuestion) -> PageResult:
        """Ask a closing question; what was typed stays where the session goes on after all."""
        draft = ""
        while True:
            page = Page(
                "question",
                self.filled(question.text),
                self.keys,
                choices=question.choices,
                draft=draft,
            )
            result = self._stage.page(page)
            if not self.quit_pressed(result):
                return result
            asked = self.ask_to_quit()
            if self.quit_pressed(asked):
                return asked
            draft = result.answer

    def ask_to_quit(self) -> PageResult:
        """Ask whether to stop."""
        keys = self._response
        text = self.filled(self._texts.quit_question)
        return self._stage.page(Page("quit", text, (*keys.quit_keys, *keys.continue_keys)))

    def filled(self, text: str, done: int = 0) -> str:
        """Return a text with its placeholders replaced."""
        return fill(text, self._response, done=done, total=self._blocks)

    def quit_pressed(self, result: PageResult) -> bool:
        """Return True if a quit key ended a page."""
        return result.key in self._response.quit_keys
